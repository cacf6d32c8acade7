"""Scenes in front of a simulated camera."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from threading import Lock
from typing import Protocol

import cv2
import numpy as np

from nvsdata.data.events import Events, concatenate
from nvsdata.emulation.imperfections import Imperfections
from nvsdata.emulation.pix2nvs import PIX2NVS
from nvsdata.emulation.pix2nvs_state import PIX2NVSState
from nvsdata.video.frames import VideoFrame

SIZE = (240, 180)
BLACK = 2  # gray level of the dark room around the screen
SETTLED = 1_000_000  # µs without a call of `events` after which pixels have adapted to the light
REFRESH = 16_667  # µs
BANDS = np.linspace(8, 172, 13).astype(int)  # rows of the screen that change together
# a pixel emits an event for each change of the light by a fifth since its last event
PIXELS = PIX2NVS(
    t_log=20, continuous=True, new=False, exp=False, max_events=8, noise_rate=0.5, mismatch=0.05, bandwidth=12e6
)
# positions (x, y) on the sensor of a screen's upper left, upper right, lower right and lower left corner
CORNERS = ((14.0, 12.0), (228.0, 8.0), (226.0, 172.0), (10.0, 168.0))


class Scene(Protocol):
    """Protocol of a scene. Times are host times in µs; events are known `lag` µs after they occur."""

    lag: int

    def events(self, start: int, stop: int) -> Events:
        """Return the events from `start` to `stop` (excluded)."""

    def pulses(self, start: int, stop: int) -> list[int]:
        """Return the times of pulses at the external input, from `start` to `stop` (excluded)."""


@dataclass
class Outlines:
    """Outline of a square that circles over the sensor, with `rate` events/s, and `noise` events/s at random pixels."""

    rate: float = 200_000
    noise: float = 20_000
    seed: int = 0
    lag: int = 0

    def events(self, start: int, stop: int) -> Events:
        rng = np.random.default_rng((self.seed, start))
        count, stray = (rng.poisson(rate * (stop - start) / 1e6) for rate in (self.rate, self.noise))
        t = np.sort(rng.integers(start, max(stop, start + 1), count + stray))
        along, edge, angle = rng.uniform(0, 60, t.size), rng.integers(0, 4, t.size), t % 2e6 * (2 * np.pi / 2e6)
        x = 90 + 60 * np.cos(angle) + np.where(edge % 2, along, 60 * (edge // 2))
        y = 60 + 45 * np.sin(angle) + np.where(edge % 2, 60 * (edge // 2), along)
        noisy = rng.permutation(t.size) < stray
        x = np.where(noisy, rng.uniform(0, 240, t.size), x)
        y = np.where(noisy, rng.uniform(0, 180, t.size), y)
        return Events(t, x.astype(int) % 240, y.astype(int) % 180, edge > 1, SIZE)

    def pulses(self, start: int, stop: int) -> list[int]:
        return []


@dataclass
class Watched:
    """A screen in a dark room, emulated by PIX2NVS: `show` must be called with each image that the screen shows.

    Args:
        pixels: The sensor's settings.
        corners: Positions (x, y) of the screen's corners on the sensor.
        scan: Time in µs in which the screen changes from top to bottom (default 12,000).
        late: Fraction of the images that appear a refresh later than `show` states (default 0).
        wired: A photodiode in the screen's upper left corner sends a pulse to the external input when that corner turns
            bright (default False).
        seed: Seed of the choice of late images (default 0).
        lag: Time in µs after which events are known (default 80,000).
    """

    pixels: PIX2NVS = PIXELS
    corners: tuple[tuple[float, float], ...] = CORNERS
    scan: int = 12_000
    late: float = 0.0
    wired: bool = False
    seed: int = 0
    lag: int = 80_000
    _shown: deque[tuple[int, np.ndarray]] = field(default_factory=deque, init=False)
    _pulses: list[int] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._lock = Lock()
        self._random = np.random.default_rng(self.seed)
        self._picture = np.full((SIZE[1], SIZE[0], 3), BLACK, np.uint8)
        self._bright = False
        self._emulator: PIX2NVSState | None = None
        self._flaws: Imperfections | None = None
        self._time = 0
        self._waiting = Events.empty(SIZE, 0)

    def show(self, time: float, picture: np.ndarray) -> None:
        """Set the image `picture` (uint8 [H, W, 3], red first) that the screen shows from `time` on."""
        # scaled down first, because each pixel records the mean of an area
        small = cv2.resize(picture, (2 * SIZE[0], 2 * SIZE[1]), interpolation=cv2.INTER_AREA)
        height, width = small.shape[:2]
        own = np.array([(0, 0), (width, 0), (width, height), (0, height)], np.float32)
        there = cv2.getPerspectiveTransform(own, np.array(self.corners, np.float32))
        seen = cv2.warpPerspective(small, there, SIZE, borderMode=cv2.BORDER_CONSTANT, borderValue=(BLACK,) * 3)
        moment = round(time) + (REFRESH if self._random.random() < self.late else 0)
        bright = bool(small[4, 4].mean() > 127)
        with self._lock:
            self._shown.append((moment, np.maximum(seen, BLACK)))
            if self.wired and bright and not self._bright:
                self._pulses.append(moment + self.scan // (2 * len(BANDS)))
        self._bright = bright

    def events(self, start: int, stop: int) -> Events:
        with self._lock:
            shown = []
            while self._shown and self._shown[0][0] < stop:
                shown.append(self._shown.popleft())
        if self._emulator is None or start - self._time > SETTLED:
            while shown and shown[0][0] < start:
                self._picture = shown.pop(0)[1]
            self._emulator = PIX2NVSState(self.pixels, VideoFrame(start, self._picture, True))
            self._flaws = Imperfections.of(self.pixels, SIZE)
            self._time, self._waiting = start, Events.empty(SIZE, start)
        pieces = [self._waiting]
        for moment, picture in shown:
            pieces += self._until(moment)
            begun, mixed = self._time, self._picture
            for n, (top, bottom) in enumerate(pairwise(BANDS), 1):
                mixed = mixed.copy()
                mixed[top:bottom] = picture[top:bottom]
                self._picture = mixed
                pieces += self._until(begun + n * self.scan // (len(BANDS) - 1))
        pieces += self._until(stop)
        events = Events.trusted(concatenate([piece.columns for piece in pieces]), SIZE, start)
        self._waiting = events.window(start=stop)
        return events.window(stop=stop)

    def _until(self, moment: int) -> list[Events]:
        """Return the events of the change to the current image, up to `moment` (µs)."""
        if moment <= self._time or self._emulator is None:
            return []
        before, self._time = self._time, moment
        events = self._emulator.step(VideoFrame(moment, self._picture, True)).events()
        return [events if self._flaws is None else self._flaws.apply(events, before, moment)]

    def pulses(self, start: int, stop: int) -> list[int]:
        with self._lock:
            due = [time for time in self._pulses if time < stop]
            self._pulses = [time for time in self._pulses if time >= stop]
        return [time for time in due if time >= start]
