"""What an emulator of event cameras is to the rest of this package."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, is_dataclass
from typing import Any, Protocol

from nvsdata.data.events import Events
from nvsdata.video.frames import VideoInput


class EventEmulator(Protocol):
    """Video to events by settings: PIX2NVS is one, and `convert_videos`, `tuning.Pair` and `tuning.search` take others.

    The settings are the object's own: a frozen dataclass, whose repr builds it again. So a folder of recordings can
    say how they were made, and a search can replace them.
    """

    def emulate(
        self,
        video: VideoInput,
        *,
        fps: float | None = None,
        times: Iterable[int] | None = None,
        size: tuple[int, int] | None = None,
    ) -> Events:
        """All events of a video; times count from its first frame, or are those of its own clock or `times`."""

    def stream(
        self,
        frames: VideoInput,
        fps: float | None = None,
        *,
        times: Iterable[int] | None = None,
        size: tuple[int, int] | None = None,
    ) -> Iterator[Events]:
        """Events of each frame in turn, those since the frame before; the first piece is empty.

        - `fps`: frames per second, in place of the times that the video states
        - `times`: in place of `fps`, the time of each frame in µs, rising
        - `size`: (width, height) in pixels that frames are scaled to
        """


def describe_settings(emulator: Any) -> dict[str, Any]:
    """An emulator's settings by name, with the name of its class as "emulator" unless that is PIX2NVS.

    TypeError if it isn't an instance of a dataclass.
    """
    if not is_dataclass(emulator) or isinstance(emulator, type):
        raise TypeError(f"an emulator is a dataclass of its settings, which {emulator!r} is not")
    name = type(emulator).__name__
    return asdict(emulator) if name == "PIX2NVS" else {"emulator": name, **asdict(emulator)}
