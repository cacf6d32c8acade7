"""Files of events: one module a format, found by content first and by extension second.

To add a format, write a module with `Recording` (a subclass of `nvsdata.data.events.Recording`) and,
if it can be written, `write(pieces, path)`, which is given `Pieces`, and add its line to `FORMATS`.
"""

from __future__ import annotations

import errno
import os
import re
import stat
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

from nvsdata.common.errors import FormatError
from nvsdata.common.files import atomic, named
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording
from nvsdata.data.samples import without_samples
from nvsdata.formats.contents import HEAD
from nvsdata.formats.pieces import Pieces

# a pipe that nobody writes to would be waited for
_READING = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)
READ_BACK = 4096  # events at the end of a file that are compared after it was written


@dataclass(frozen=True)
class Format:
    """A line of the registry: what a file begins with; without that, the module's `looks_like` tells.

    A format with both is told by `looks_like` where only the extension speaks for it.
    """

    name: str
    module: str
    suffixes: tuple[str, ...]
    begins: re.Pattern[bytes] | None = None

    def load(self) -> ModuleType:
        """The module that reads and writes it; imported only now."""
        return _module(self.module)


@cache
def _module(name: str) -> ModuleType:
    return import_module(name if "." in name else f"nvsdata.formats.{name}")


# the first that matches is it
FORMATS = (
    Format("hdf5", "hdf5", (".h5", ".hdf5"), re.compile(rb"\x89HDF\r\n\x1a\n")),
    Format("davis", "nvsdata.recording.davis.file", (".davis",), re.compile(rb"#!DAVIS-STREAM1 ")),
    Format("aedat2", "aedat2", (".aedat",), re.compile(rb"#!AER-DAT2\.")),
    Format("aedat1", "aedat1", (".aedat1", ".aedat"), re.compile(rb"#!AER-DAT1\.")),
    Format("aedat3", "aedat3", (".aedat3", ".aedat"), re.compile(rb"#!AER-DAT3\.")),
    Format("aedat4", "aedat4", (".aedat4", ".aedat"), re.compile(rb"#!AER-DAT4\.")),
    Format("evt", "evt", (".raw",), re.compile(rb"(?:%[^\n]*\n)*?% (?i:evt |format EVT)[23]")),
    Format("prophesee-dat", "prophesee", (".dat",), re.compile(rb"% ")),
    Format("matlab", "matlab", (".mat",), re.compile(rb"MATLAB [57]\.\d MAT-file")),
    Format("npy", "npy", (".npy",), re.compile(rb"\x93NUMPY")),
    Format("text", "text", (".txt", ".csv", ".text")),
    Format("atis", "atis", (".bin", ".bs2")),
)
_FIRST_BYTES = b"\x89#%M\x93"  # of the formats that begin with something


def open(path: str | os.PathLike[str], *, sensor_size: tuple[int, int] | None = None, strict: bool = True) -> Recording:
    """Open a file of events without decoding it.

    `sensor_size` (width, height) overrides what the file says, or says it where the file doesn't.
    Without `strict`, a damaged file is read as far as it makes sense: a torn tail is cut off and
    events outside the sensor are dropped; the recording's `repairs` says how many.

    Raises FileNotFoundError, and FormatError for a directory, an empty file of a format that
    needs a header, or content that no known format explains.
    """
    path = os.path.expanduser(os.fspath(path))
    head = _head(path)
    recording: Recording = _identify(path, head).load().Recording(path, sensor_size, head, strict)
    return recording


def read(
    path: str | os.PathLike[str],
    start: int | None = None,
    stop: int | None = None,
    *,
    sensor_size: tuple[int, int] | None = None,
    relative: bool = False,
    strict: bool = True,
) -> Events:
    """Events of a file with start <= t < stop, in µs of the file's own clock; see `open`.

    Few cameras' clocks begin at 0, so `read(path, 0, 30_000)` holds no event of most files, and warns. With
    `relative`, `start` and `stop` count from the recording's first event; the events keep the file's times.
    """
    recording = open(path, sensor_size=sensor_size, strict=strict)
    if relative:
        first = recording.span[0]
        start, stop = (None if bound is None else first + bound for bound in (start, stop))
    events = recording.read(start, stop)
    if not len(events) and (start, stop) != (None, None):
        _warn_outside(recording, start, stop)
    return events


def _warn_outside(recording: Recording, start: int | None, stop: int | None) -> None:
    """Tell of a window that lies before the first or after the last event."""
    first, last = recording.span if recording.knows_span else (0, 0)
    if first < last and ((stop is not None and stop <= first) or (start is not None and start > last)):
        window = f"[{'' if start is None else start}, {'' if stop is None else stop})"
        warnings.warn(
            f"{recording.path}: the window {window} holds nothing, its events lie at {first} to {last} µs;"
            " relative=True counts from the first",
            stacklevel=3,
        )


def write(events: Events | Recording | Iterable[Events], path: str | os.PathLike[str]) -> int:
    """Write events in the format that the extension of `path` names; the file appears whole or not at all.

    Returns how many events were written.

    An iterable of pieces, each no earlier than the one before (as `PIX2NVS.stream` gives them), is
    written as it comes, in constant memory; the first piece states the sensor. HDF5 and AEDAT 2 keep frames and
    inertial samples of a Recording, or of a `Piece`; other formats hold events alone.

    Raises ValueError for an unknown extension, a format that can't be written, events that
    the format can't hold (every format but HDF5 and text has such), and pieces that are out of
    order, of different sensors, or none.
    """
    path = os.path.expanduser(path)
    module = writer_of(path)
    given = [events] if isinstance(events, Events) else events.pieces() if isinstance(events, Recording) else events
    if not module.Recording.holds_samples:
        given = map(without_samples, given)
    pieces = Pieces(given)
    with named(path), atomic(path) as temporary:
        module.write(pieces, temporary)
        _check_written(module, temporary, pieces)
    return pieces.count


def left_out(recording: Recording, path: str | os.PathLike[str]) -> bool:
    """Whether a recording has frames or inertial samples that a file of this extension can't hold."""
    if not recording.holds_samples or writer_of(path).Recording.holds_samples:
        return False
    return bool(recording.inertial().t.size) or next(iter(recording.frames()), None) is not None


def writer_of(path: str | os.PathLike[str]) -> ModuleType:
    """The module that writes files of this extension; ValueError if there is none."""
    suffix = Path(path).suffix.lower()
    module = next((f.load() for f in FORMATS if suffix in f.suffixes), None)
    if module is None or not hasattr(module, "write"):
        known = ", ".join(s for f in FORMATS if hasattr(f.load(), "write") for s in f.suffixes)
        raise ValueError(f"{path}: can't tell a format to write from {suffix!r}; known are {known}")
    return module


def _check_written(module: ModuleType, path: Path, pieces: Pieces) -> None:
    """OSError unless the file's last events are those that were written: not every full disk tells by itself."""
    if pieces.last is None:
        return
    first = int(pieces.last.t[-READ_BACK:][0])
    wanted = pieces.last.window(first, None)
    try:
        found = module.Recording(str(path), pieces.sensor_size, _head(str(path)), True).read(first, None)
        # those at the same time may have come with the piece before
        same = found[max(len(found) - len(wanted), 0) :] == wanted
    except FormatError as error:
        raise OSError(errno.EIO, f"can't be read back after it was written: {error.reason}") from error
    if not same:
        raise OSError(errno.EIO, "doesn't hold what was written to it: is the disk full, or broken?")


def suffixes() -> tuple[str, ...]:
    """Extensions, lower case with their dot, of all formats that can be opened."""
    return tuple(s for f in FORMATS for s in f.suffixes)


def _head(path: str) -> bytes:
    """The first bytes of a file; all of it if it is small."""
    # plain system calls: a file object costs twice as much, and small files come by the 100,000
    handle = os.open(path, _READING)
    try:
        head = os.read(handle, HEAD)
        if not head and not stat.S_ISREG(os.fstat(handle).st_mode):
            raise FormatError(path, None, "is a pipe or a device, not a recording")
        return head
    except BlockingIOError:
        raise FormatError(path, None, "is a pipe or a device, not a recording") from None
    except IsADirectoryError:
        raise FormatError(path, None, "is a directory, not a recording") from None
    finally:
        os.close(handle)


_HEADERLESS = {suffix: candidate for candidate in FORMATS if not candidate.begins for suffix in candidate.suffixes}


def _identify(path: str, head: bytes) -> Format:
    if head[:1] in _FIRST_BYTES:
        for candidate in FORMATS:
            if candidate.begins and candidate.begins.match(head):
                return candidate
    suffix = os.path.splitext(path)[1].lower()
    if suffix in _HEADERLESS:
        return _HEADERLESS[suffix]
    for candidate in FORMATS:
        if head and (not candidate.begins or suffix in candidate.suffixes):
            looks_like = getattr(candidate.load(), "looks_like", None)
            if looks_like is not None and looks_like(head, os.path.getsize(path)):
                return candidate
    for candidate in FORMATS:
        if suffix in candidate.suffixes:
            what = "is empty" if not head else "does not begin as one"
            raise FormatError(path, 0, f"the extension says {candidate.name}, but the file {what}")
    raise FormatError(path, 0, "empty file of unknown format" if not head else "unknown format")
