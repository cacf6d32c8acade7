"""Files of events: one module a format, found by content first and by extension second.

To add a format, write a module with `Recording` (a subclass of `nvsdata.events.Recording`) and,
if it can be written, `write(pieces, sensor_size, path)`, and add its line to `FORMATS`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from itertools import chain
from pathlib import Path
from types import ModuleType

from nvsdata.errors import FormatError
from nvsdata.events import Events, Recording
from nvsdata.files import atomic
from nvsdata.formats.records import HEAD


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
    return import_module(f"nvsdata.formats.{name}")


# the first that matches is it
FORMATS = (
    Format("hdf5", "hdf5", (".h5", ".hdf5"), re.compile(rb"\x89HDF\r\n\x1a\n")),
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
    path = os.fspath(path)
    head = _head(path)
    recording: Recording = _identify(path, head).load().Recording(path, sensor_size, head, strict)
    return recording


def read(
    path: str | os.PathLike[str],
    start: int | None = None,
    stop: int | None = None,
    *,
    sensor_size: tuple[int, int] | None = None,
    strict: bool = True,
) -> Events:
    """Events of a file with start <= t < stop (µs, as in the file); see `open`."""
    return open(path, sensor_size=sensor_size, strict=strict).read(start, stop)


def write(events: Events | Recording | Iterable[Events], path: str | os.PathLike[str]) -> None:
    """Write events in the format that the extension of `path` names; the file appears whole or not at all.

    An iterable of pieces, each no earlier than the one before (as `PIX2NVS.stream` gives them), is
    written as it comes, in constant memory; the first piece states the sensor.

    Raises ValueError for an unknown extension, a format that can't be written, events that
    the format can't hold (every format but HDF5 and text has such), and pieces that are out of
    order, of different sensors, or none.
    """
    module = writer_of(path)
    pieces = [events] if isinstance(events, Events) else [events.read()] if isinstance(events, Recording) else events
    sensor_size, checked = _in_line(pieces)
    with atomic(path) as temporary:
        module.write(checked, sensor_size, temporary)


def writer_of(path: str | os.PathLike[str]) -> ModuleType:
    """The module that writes files of this extension; ValueError if there is none."""
    suffix = Path(path).suffix.lower()
    module = next((f.load() for f in FORMATS if suffix in f.suffixes), None)
    if module is None or not hasattr(module, "write"):
        known = ", ".join(s for f in FORMATS if hasattr(f.load(), "write") for s in f.suffixes)
        raise ValueError(f"{path}: can't tell a format to write from {suffix!r}; known are {known}")
    return module


def _in_line(pieces: Iterable[Events]) -> tuple[tuple[int, int], Iterator[Events]]:
    """The sensor of the first piece, and the pieces that are not empty, checked as they pass."""
    waiting = iter(pieces)
    first = next(waiting, None)
    if first is None:
        raise ValueError("can't write no piece of events: not even an empty one states the sensor")
    return first.sensor_size, _checked(first, waiting)


def _checked(first: Events, others: Iterator[Events]) -> Iterator[Events]:
    last = None
    for piece in chain((first,), others):
        if piece.sensor_size != first.sensor_size:
            raise ValueError(f"pieces of different sensors: {first.sensor_size} and {piece.sensor_size}")
        if len(piece) == 0:
            continue
        if last is not None and piece.t[0] < last:
            raise ValueError(f"a piece begins at {piece.t[0]} µs, but the one before it ends at {last} µs")
        last = piece.t[-1]
        yield piece


def suffixes() -> tuple[str, ...]:
    """Extensions, lower case with their dot, of all formats that can be opened."""
    return tuple(s for f in FORMATS for s in f.suffixes)


def _head(path: str) -> bytes:
    """The first bytes of a file; all of it if it is small."""
    # plain system calls: a file object costs twice as much, and small files come by the 100,000
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
    try:
        return os.read(handle, HEAD)
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
