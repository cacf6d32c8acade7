"""Films of events, with a frame per window, as GIF, MP4 or one sheet of images."""

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
from nvsdata.plots.drawing import BOTH, OFF, ON, event_image
from nvsdata.plots.sheets import captioned_sheet

WINDOW = 33_333  # µs
WIDE = 480  # pixels; images of narrower sensors are enlarged to about this width
MOMENTS = 12  # images on a sheet
COLORS = (255, 255, 255), ON, OFF, BOTH
MOST_IN_GIF = 3_000
GIF_TICK = 10  # ms, the unit of durations in a GIF


@dataclass(frozen=True)
class Film:
    """Settings of a film of events.

    Args:
        duration: Length in µs of the window that each frame shows (default 33,333).
        count: Number of events that each frame shows, in place of `duration`; frames follow each other without gaps
            or overlaps (default None: frames by time).
        speed: Speed of the film; 1 (default) is real time. It applies to frames by time only.
        fps: Frames per second (default 30.0).
        zoom: Side in pixels of the square that is drawn for each pixel of the sensor (default None: images of narrow
            sensors are enlarged to a width of about 480 pixels).

    Raises:
        ValueError: If a setting is out of range.

    Example:
        >>> events = Events([0, 100_000], [0, 3], [1, 1], [1, 0])
        >>> sum(1 for image in Film(fps=10).images(events))
        2
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
        """Yield the events of each frame of the film; there is at least one frame."""
        if self.count is not None:
            for first in range(0, max(len(events), 1), int(self.count)):
                yield events[first : first + int(self.count)]
            return
        step = 1e6 * self.speed / self.fps
        frames = int((events.end - events.start) / step) + 1
        check_count(frames)
        for n in range(frames):
            start = events.start + round(n * step)
            yield events.window(start, start + int(self.duration))

    def images(self, events: Events) -> Iterator[np.ndarray]:
        """Yield the frames, uint8 [H, W, 3], BGR."""
        for window in self.windows(events):
            yield event_image(window, self._zoom(events))

    def sheet(self, events: Events) -> np.ndarray:
        """Draw up to 12 evenly spaced windows, each with time and number of events; return uint8 [H, W, 3], BGR."""
        tiles = []
        for window in self._moments(events):
            # `start` of a slice by number is that of the recording, not the time of its first event
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


def save_gif(images: Iterable[np.ndarray], path: Path, fps: float) -> None:
    """Write images of `event_image` as a GIF that repeats. The file is complete or missing, never partial.

    Durations in a GIF are in hundredths of a second, and viewers slow down frames shorter than 20 ms. So the GIF has at
    most 50 frames per second.

    Args:
        images: uint8 [H, W, 3], BGR. All of them are kept in memory.
        path: The file.
        fps: Frames per second.

    Raises:
        ValueError: If there are more than 3,000 images.
    """
    from PIL import Image

    palette = np.array([color[::-1] for color in COLORS], np.uint8)
    frames: list[Image.Image] = []
    for image in images:
        if len(frames) == MOST_IN_GIF:
            raise ValueError(f"a GIF has at most {MOST_IN_GIF:,} frames: select a part of the events, or write an .mp4")
        frame = Image.fromarray(_numbers(image))
        frame.putpalette(palette.tobytes())
        frames.append(frame)
    buffer = io.BytesIO()
    # each frame ends at the nearest tick, so that rounding errors don't add up
    ends = [max(GIF_TICK * round(1e3 * n / fps / GIF_TICK), 2 * GIF_TICK * n) for n in range(len(frames) + 1)]
    durations = np.diff(ends).tolist()
    frames[0].save(
        buffer, "GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0, disposal=1, optimize=False
    )
    put(path, buffer.getvalue(), through_link=True)


def _numbers(image: np.ndarray) -> np.ndarray:
    """Return the number of each pixel's color in the palette, uint8 [H, W]."""
    numbers = np.zeros(image.shape[:2], np.uint8)
    for number, color in enumerate(COLORS):
        numbers[(image == color).all(2)] = number
    return numbers


def _check_film(name: str, count: int) -> None:
    """Raise OSError unless the film has `count` frames: OpenCV doesn't report a full disk."""
    film = cv2.VideoCapture(name, cv2.CAP_FFMPEG)
    found = int(film.get(cv2.CAP_PROP_FRAME_COUNT)) if film.isOpened() else 0
    film.release()
    if found != count:
        raise OSError(errno.EIO, f"has {found:,} of {count:,} frames: is the disk of temporary files full?", name)


def save_mp4(images: Iterable[np.ndarray], path: Path, fps: float) -> None:
    """Write images as an MP4 file (MPEG-4 part 2), which is complete or missing, never partial.

    Args:
        images: uint8 [H, W, 3], BGR, all of one size.
        path: The file.
        fps: Frames per second.

    Raises:
        OSError: If OpenCV can't encode the film, or if the disk of temporary files is full.
    """
    count = 0
    with tempfile.TemporaryDirectory() as folder:
        name = str(Path(folder) / "film.mp4")
        writer = None
        for image in images:
            # encoders require even sides
            even = np.pad(image, ((0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)), mode="edge")
            if writer is None:
                writer = cv2.VideoWriter(name, cv2.VideoWriter.fourcc(*"mp4v"), fps, even.shape[1::-1])
                if not writer.isOpened():
                    raise OSError(f"OpenCV can't write MP4 files of {even.shape[1]}x{even.shape[0]} pixels")
            writer.write(even)
            count += 1
        if writer is not None:
            writer.release()
            _check_film(name, count)
        put(path, Path(name).read_bytes(), through_link=True)
