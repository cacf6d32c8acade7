"""Protocol of a camera: `record` accepts any object that has these members."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np

from nvsdata.data.samples import Piece


class CameraError(OSError):
    """Error of a camera; the message is one line with the reason and a remedy."""


class Unplugged(CameraError):
    """The camera was disconnected."""


class Facts(Protocol):
    """Description of a camera: name, serial number, and the size of its sensor in pixels."""

    @property
    def name(self) -> str: ...
    @property
    def serial(self) -> str: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...


class StreamDecoder(Protocol):
    """Decoder of a camera's stream; `width` and `height` are those of the sensor in pixels."""

    width: int
    height: int

    @property
    def error_counts(self) -> dict[str, int]:
        """Number of faults of each kind in the stream so far, by name."""

    def decoded(self, blocks: Iterable[bytes], last: int | None) -> Iterator[tuple[Piece, np.ndarray]]:
        """Yield the contents of blocks of the stream, and the times (µs, int64) of pulses at the external input.

        Times are relative to the last reset of the camera's clock. Data before this reset are left out, and so are data
        from time `last` (µs) on, unless `last` is None.
        """


@runtime_checkable
class Camera(Protocol):
    """Protocol of a connected camera.

    The order of calls is `configure`, `start`, `reset_time`, `stop`, any number of times. Between `start` and `stop` a
    thread calls `read`, and finally `end_reading`. Methods raise CameraError, or Unplugged if the camera was
    disconnected.
    """

    # bytes of a word of the stream: an incomplete word at the end of a block is dropped and counted
    unit: int
    # s without a byte after which the camera counts as stalled; None for a camera that may be silent for any time
    silence: float | None

    @property
    def facts(self) -> Facts:
        """The description of the camera."""

    def configure(self, settings: Any = None) -> None:
        """Set biases, region and so on; None sets the defaults.

        Raises:
            ValueError: The camera doesn't have these settings.
        """

    def start(self) -> None:
        """Start the stream."""

    def reset_time(self) -> None:
        """Restart the camera's time at 0."""

    def read(self, timeout: int = 100) -> bytes:
        """Return the bytes of the stream that arrive within `timeout` ms, maybe none."""

    def stop(self) -> None:
        """End the stream; bytes in transit can still be read."""

    def end_reading(self) -> None:
        """Clean up after the last `read`; called by the thread that read."""

    def dropped(self) -> int | None:
        """Return the number of events that the camera dropped since power-on; None if it doesn't count them."""

    def decoder(self) -> StreamDecoder:
        """Return a new decoder of the camera's stream; its times never decrease."""

    def about(self) -> dict[str, Any]:
        """Return the camera's metadata for its recordings, as in `Recording.about`."""

    def journal_head(self, decoder: Any, last: int | None, about: Mapping[str, Any]) -> bytes | None:
        """Return the first bytes of a journal, a file of the stream that `nvsdata.open` reads.

        Return None if there is no such format. Then a recording is lost if the process is killed.
        """

    def close(self) -> None:
        """Release the camera."""


def check_camera(camera: object) -> None:
    """Raise TypeError for an object without all members of a camera."""
    # isinstance isn't used: since Python 3.12 it ignores members from __getattr__, which a wrapper may have
    members = [name for name in (*Camera.__annotations__, *vars(Camera)) if not name.startswith("_")]
    if missing := ", ".join(name for name in members if not hasattr(camera, name)):
        what = f"{type(camera).__name__} is not a camera: it misses {missing}"
        raise TypeError(f"{what} (see nvsdata.recording.camera.Camera)")


def host_time() -> float:
    """Return the host's time in µs since an arbitrary moment."""
    return time.perf_counter() * 1e6
