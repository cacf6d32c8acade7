"""Protocol of emulators."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, is_dataclass
from typing import Any, Protocol

from nvsdata.data.events import Events
from nvsdata.video.frames import VideoInput


class EventEmulator(Protocol):
    """Emulator of an event camera; `convert_videos`, `TuningPair` and `tuning.search` accept any with these methods.

    An emulator is a frozen dataclass of its settings, so that a manifest can describe it and a search can change it.
    """

    def emulate(
        self,
        video: VideoInput,
        *,
        fps: float | None = None,
        times: Iterable[int] | None = None,
        size: tuple[int, int] | None = None,
    ) -> Events:
        """Return all events of a video; times are relative to its first frame, or in its own clock."""

    def stream(
        self,
        frames: VideoInput,
        fps: float | None = None,
        *,
        times: Iterable[int] | None = None,
        size: tuple[int, int] | None = None,
    ) -> Iterator[Events]:
        """Yield the events between each frame and the one before; the first piece is empty.

        Args:
            frames: A video, as `PIX2NVS.stream` takes it.
            fps: Frames per second, in place of the video's own times.
            times: Times of the frames in µs, rising, in place of `fps`.
            size: (width, height) in pixels that frames are scaled to.
        """


def describe_settings(emulator: Any) -> dict[str, Any]:
    """Return an emulator's settings by name, and the name of its class as "emulator" unless that is PIX2NVS.

    Raises:
        TypeError: The emulator isn't an instance of a dataclass.
    """
    if not is_dataclass(emulator) or isinstance(emulator, type):
        raise TypeError(f"an emulator must be an instance of a dataclass, not {emulator!r}")
    name = type(emulator).__name__
    return asdict(emulator) if name == "PIX2NVS" else {"emulator": name, **asdict(emulator)}
