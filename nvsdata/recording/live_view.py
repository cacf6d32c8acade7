"""Window that shows events live."""

from __future__ import annotations

import os
from threading import Lock
from typing import Any, Self

import cv2
import numpy as np

from nvsdata.data.events import Events, concatenate
from nvsdata.plots import event_image
from nvsdata.recording.camera import host_time

EVERY = 33_000  # µs between images
SPAN = 33_000  # µs of events in an image
ZOOM = 3


class DisplayError(OSError):
    """Error of a display; the message is one line with the reason."""


class LiveView:
    """Window with the events of the last 33 ms, their rate and sharpness; use it in a `with` block.

    `add` may be called from any thread. `draw` must be called often, from the main thread only. `closed` is True after
    the user has closed the window.

    Raises:
        DisplayError: There is no display.
    """

    def __init__(self, sensor_size: tuple[int, int]) -> None:
        self.size = sensor_size
        self._pygame = pygame = pygame_or_error()
        try:
            pygame.display.init()
            self._window = pygame.Window("nvsdata", (sensor_size[0] * ZOOM, sensor_size[1] * ZOOM))
            self._surface = self._window.get_surface()
        except pygame.error as error:
            raise DisplayError(f"events can't be shown: {error}") from None
        self._lock = Lock()
        self._events = Events.empty(sensor_size, 0)
        self._drawn = 0.0
        self.closed = False

    def add(self, events: Events) -> None:
        """Add the next events; those older than 33 ms are dropped."""
        if len(events) == 0:
            return
        with self._lock:
            both = Events.trusted(concatenate([self._events.columns, events.columns]), self.size, 0)
            self._events = both.window(start=int(both.t[-1]) - SPAN)

    def draw(self) -> None:
        """Draw the events, if 33 ms have passed since the last image."""
        now = host_time()
        if now - self._drawn < EVERY:
            return
        self._drawn = now
        with self._lock:
            events = self._events
        self._window.title = f"{len(events) * 1e3 / SPAN:,.0f} k events/s, sharpness {sharpness(events):.2f}"
        image = np.ascontiguousarray(event_image(events, ZOOM)[..., ::-1])
        self._surface.blit(self._pygame.image.frombuffer(image, image.shape[1::-1], "RGB"), (0, 0))
        self._window.flip()

    def attend(self) -> None:
        """Handle window and keyboard if no `Monitor` does that; Escape, or closing the window, sets `closed`."""
        for event in self._pygame.event.get():
            escape = event.type == self._pygame.KEYDOWN and event.key == self._pygame.K_ESCAPE
            self.closed |= escape or event.type in (self._pygame.QUIT, self._pygame.WINDOWCLOSE)

    def close(self) -> None:
        """Close the window."""
        self._window.destroy()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


def sharpness(events: Events) -> float:
    """Return the sharpness of an event image, the energy of its Laplacian divided by that of the image."""
    width, height = events.sensor_size
    signed = np.bincount(events.y * np.intp(width) + events.x, events.p * 2.0 - 1, width * height)
    image = cv2.GaussianBlur(signed.reshape(height, width).astype(np.float64), (0, 0), 1)
    energy = float((image**2).mean())
    return float((cv2.Laplacian(image, cv2.CV_64F) ** 2).mean()) / energy if energy else 0.0


def pygame_or_error() -> Any:
    """Return the module pygame; if it is missing, raise ImportError with the command that installs it."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    # a click into the other window must not minimize the one that shows videos
    os.environ.setdefault("SDL_VIDEO_MINIMIZE_ON_FOCUS_LOSS", "0")
    try:
        import pygame
    except ImportError:
        raise ImportError("a monitor or window needs pygame-ce: pip install 'nvsdata[monitor]'") from None
    return pygame
