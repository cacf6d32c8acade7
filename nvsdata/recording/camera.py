"""What a camera is to the rest of this package: `record` takes any object that has these members."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np

from nvsdata.data.samples import Piece


class CameraError(OSError):
    """What keeps a camera from recording, in one line that says what to do."""


class Unplugged(CameraError):
    """The camera is gone."""


class Facts(Protocol):
    """What a camera says of itself: name, serial number, and the size of its sensor in pixels."""

    @property
    def name(self) -> str: ...
    @property
    def serial(self) -> str: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...


class Decoder(Protocol):
    """What understands a camera's stream."""

    width: int
    height: int

    @property
    def complaints(self) -> dict[str, int]:
        """What was odd in the stream so far, counted."""

    def decoded(self, blocks: Iterable[bytes], last: int | None) -> Iterator[tuple[Piece, np.ndarray]]:
        """What blocks of the stream hold, and the times (µs, int64) of pulses at the external input.

        Times count from the last reset of the camera's clock; what came before it, and what comes from `last` (µs)
        on, is left out.
        """


@runtime_checkable
class Camera(Protocol):
    """A camera that is connected.

    The order is: `configure`, `start`, `reset_time`, `stop`, as often as wanted; between `start` and `stop` a thread
    calls `read`, and `end_reading` when it is done. Methods raise CameraError, Unplugged if the camera is gone.
    """

    @property
    def facts(self) -> Facts:
        """What it says of itself."""

    def configure(self, settings: Any = None) -> None:
        """Set biases, region and so on; None for its defaults. ValueError for settings that it doesn't have."""

    def start(self) -> None:
        """Let the stream begin."""

    def reset_time(self) -> None:
        """Let the camera's time begin at 0."""

    def read(self, timeout: int = 100) -> bytes:
        """What came of the stream within `timeout` ms, maybe nothing."""

    def stop(self) -> None:
        """End the stream; what is on its way can still be read."""

    def end_reading(self) -> None:
        """After the last `read`, by the thread that read."""

    def dropped(self) -> int | None:
        """Events that the camera itself has dropped since it has power; None if it doesn't count them."""

    def decoder(self) -> Decoder:
        """A new decoder of its stream, whose times never fall."""

    def about(self) -> dict[str, Any]:
        """What recordings say of the camera, as `Recording.about`."""

    def journal_head(self, decoder: Any, last: int | None, about: Mapping[str, Any]) -> bytes | None:
        """What a file begins with that keeps the stream as it comes, and that `nvsdata.open` reads.

        None if there is no such format: what was recorded is lost then if the process is killed.
        """

    def close(self) -> None:
        """Let the camera go."""


def check_camera(camera: object) -> None:
    """TypeError for an object that lacks members of a camera."""
    if isinstance(camera, Camera):
        return
    members = [name for name in vars(Camera) if not name.startswith("_")]
    lacking = ", ".join(name for name in members if not hasattr(camera, name))
    raise TypeError(f"{type(camera).__name__} is no camera: it lacks {lacking} (see nvsdata.recording.camera.Camera)")
