"""Films of events: a picture per window, as GIF, MP4 or one sheet."""

from __future__ import annotations

import errno
import io
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from nvsdata.common.files import put
from nvsdata.common.validation import microseconds, positive, whole
from nvsdata.data.events import Events
from nvsdata.data.frame_edges import check_count
from nvsdata.plots.drawing import BOTH, OFF, ON
from nvsdata.plots.events import event_image
from nvsdata.plots.sheets import captioned_sheet

WINDOW = 33_333  # µs
WIDE = 480  # pixels that small sensors are scaled up to
MOMENTS = 12  # on a sheet
COLORS = (255, 255, 255), ON, OFF, BOTH
MOST_IN_GIF = 3_000
GIF_TICK = 10  # ms, in which a GIF counts


@dataclass(frozen=True)
class Film:
    """How events become a film.

    - `duration`: of the window that each picture shows, in µs (default 33,333); or
    - `count`: number of events that each picture shows, one after the other (default None: by time)
    - `speed`: of the film's clock, 1 (default) being real time; by time only
    - `fps`: pictures per second (default 30.0)
    - `zoom`: side in pixels of the sensor's pixels (default None: small sensors are scaled up to 480 pixels)

    ValueError for settings out of range.
    """

    duration: int = WINDOW
    count: int | None = None
    speed: float = 1.0
    fps: float = 30.0
    zoom: int | None = None

    def __post_init__(self) -> None:
        microseconds("duration", self.duration)
        positive("speed", self.speed)
        positive("fps", self.fps)
        for name in ("count", "zoom"):
            if getattr(self, name) is not None:
                whole(name, getattr(self, name), 1)

    def windows(self, events: Events) -> Iterator[Events]:
        """The events of each picture, at least one picture."""
        if self.count is not None:
            for first in range(0, max(len(events), 1), int(self.count)):
                yield events[first : first + int(self.count)]
            return
        step = 1e6 * self.speed / self.fps
        pictures = int((events.end - events.start) / step) + 1
        check_count(pictures)
        for n in range(pictures):
            start = events.start + round(n * step)
            yield events.window(start, start + int(self.duration))

    def pictures(self, events: Events) -> Iterator[np.ndarray]:
        """uint8 [H, W, 3], BGR, one after the other."""
        for window in self.windows(events):
            yield event_image(window, self._zoom(events))

    def sheet(self, events: Events) -> np.ndarray:
        """Moments from beginning to end, each with its time and number of events: uint8 [H, W, 3], BGR."""
        tiles = []
        for window in self._moments(events):
            # slices by number keep the whole's beginning
            first = window.start if self.count is None or not len(window) else int(window.t[0])
            at = (first - events.start) / 1e3
            tiles.append((event_image(window), [f"{at:,.1f} ms: {len(window):,} events"]))
        return captioned_sheet(tiles, columns=4, side=240)

    def _moments(self, events: Events) -> list[Events]:
        if self.count is not None:
            firsts = np.linspace(0, max(len(events) - int(self.count), 0), MOMENTS).astype(int).tolist()
            return [events[first : first + int(self.count)] for first in dict.fromkeys(firsts)]
        last = max(events.end + 1 - int(self.duration), events.start)
        starts = np.linspace(0, last - events.start, MOMENTS).astype(np.int64).tolist()
        return [
            events.window(events.start + at, events.start + at + int(self.duration)) for at in dict.fromkeys(starts)
        ]

    def _zoom(self, events: Events) -> int:
        return int(self.zoom or max(1, WIDE // events.sensor_size[0]))


def save_gif(pictures: Iterable[np.ndarray], path: Path, fps: float) -> None:
    """Write pictures of `event_image`, uint8 [H, W, 3], as a GIF that repeats; the file appears whole or not at all.

    A GIF counts in hundredths of a second, so that more than 50 pictures per second are not to be had. ValueError for
    more than 3,000 pictures, which are all in memory.
    """
    from PIL import Image

    palette = np.array([color[::-1] for color in COLORS], np.uint8)
    frames: list[Image.Image] = []
    for picture in pictures:
        if len(frames) == MOST_IN_GIF:
            raise ValueError(f"a GIF of more than {MOST_IN_GIF:,} pictures: take a part, or write an .mp4")
        frame = Image.fromarray(_numbers(picture))
        frame.putpalette(palette.tobytes())
        frames.append(frame)
    buffer = io.BytesIO()
    # each frame ends at the nearest tick, so that their errors don't add up
    ends = [max(GIF_TICK * round(1e3 * n / fps / GIF_TICK), 2 * GIF_TICK * n) for n in range(len(frames) + 1)]
    durations = np.diff(ends).tolist()
    frames[0].save(
        buffer, "GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0, disposal=1, optimize=False
    )
    put(path, buffer.getvalue(), through_link=True)


def _numbers(picture: np.ndarray) -> np.ndarray:
    """Number of each pixel's color in the palette: uint8 [H, W]."""
    numbers = np.zeros(picture.shape[:2], np.uint8)
    for number, color in enumerate(COLORS):
        numbers[(picture == color).all(2)] = number
    return numbers


def _check_film(name: str, count: int) -> None:
    """OSError unless the film has so many pictures: OpenCV doesn't report what a disk doesn't take."""
    film = cv2.VideoCapture(name, cv2.CAP_FFMPEG)
    found = int(film.get(cv2.CAP_PROP_FRAME_COUNT)) if film.isOpened() else 0
    film.release()
    if found != count:
        raise OSError(errno.EIO, f"holds {found:,} of {count:,} pictures: is the disk of temporary files full?", name)


def save_mp4(pictures: Iterable[np.ndarray], path: Path, fps: float) -> None:
    """Write pictures, uint8 [H, W, 3], BGR, as an MP4 (MPEG-4 part 2); the file appears whole or not at all.

    OSError if OpenCV can't encode it, or if the disk of temporary files is full.
    """
    count = 0
    with tempfile.TemporaryDirectory() as folder:
        name = str(Path(folder) / "film.mp4")
        writer = None
        for picture in pictures:
            # encoders want even sides
            even = np.pad(picture, ((0, picture.shape[0] % 2), (0, picture.shape[1] % 2), (0, 0)), mode="edge")
            if writer is None:
                writer = cv2.VideoWriter(name, cv2.VideoWriter.fourcc(*"mp4v"), fps, even.shape[1::-1])
                if not writer.isOpened():
                    raise OSError(f"OpenCV can't write MP4 files of {even.shape[1]}x{even.shape[0]} pixels here")
            writer.write(even)
            count += 1
        if writer is not None:
            writer.release()
            _check_film(name, count)
        put(path, Path(name).read_bytes(), through_link=True)
