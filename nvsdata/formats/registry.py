"""Registry of formats, and recognition of a file's format."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from nvsdata.common.errors import FormatError, shown
from nvsdata.common.registry import Registry
from nvsdata.data.recording import Recording
from nvsdata.formats.writing import Pieces


@dataclass(eq=False)
class Format:
    """A format of files: functions that recognize, open and write them.

    Args:
        name: Name that `nvsdata info` shows.
        suffixes: Extensions in lower case, with their dot. New files get the first one.
        open: `open(path, sensor_size, head, strict)` returns the `Recording` of a file. `head` is its first 64 KiB, or
            the entire file if it is shorter.
        begins: `begins(head)` returns whether a file that begins with `head` is certainly of this format, by its
            signature (default None: files of the format have no signature).
        looks_like: `looks_like(head, size)` returns whether a file of `size` bytes that begins with `head` could be of
            this format. It is called if neither a signature nor an extension decides (default None).
        write: `write(pieces, path)` writes a new file (default None: the format is only read).
        holds_samples: Whether files can contain frames and inertial samples (default False).
        has_streams: Whether `open` takes paths with the name of a stream, as `split_stream` splits them (default
            False).
        packages: Packages of extras that some files of the format need (default none).

    Example:
        >>> from nvsdata.formats import FORMATS
        >>> FORMATS["text"].suffixes
        ('.txt', '.csv', '.text')
    """

    name: str
    suffixes: tuple[str, ...]
    open: Callable[[str, tuple[int, int] | None, bytes, bool], Recording]
    begins: Callable[[bytes], Any] | None = None
    looks_like: Callable[[bytes, int], bool] | None = None
    write: Callable[[Pieces, Path], None] | None = None
    holds_samples: bool = False
    has_streams: bool = False
    packages: tuple[str, ...] = ()


STORE = b"NVSSTORE"  # first bytes of a packed store


def starts_with(mark: bytes) -> Callable[[bytes], bool]:
    """Return a function `begins` for a format whose files begin with `mark`."""
    return lambda head: head.startswith(mark)


# nvsdata's own formats, named like entry points; if several fit a file, the first is taken
BUILT_IN = (
    "nvsdata.formats.hdf5:FORMAT",
    "nvsdata.formats.hdf5:COMPRESSED",
    "nvsdata.recording.davis.file:FORMAT",
    "nvsdata.formats.aedat.aedat2:FORMAT",
    "nvsdata.formats.aedat.aedat1:FORMAT",
    "nvsdata.formats.aedat.aedat3:FORMAT",
    "nvsdata.formats.aedat.aedat4:FORMAT",
    "nvsdata.formats.ros:ROS1",
    "nvsdata.formats.ros:ROS2",
    "nvsdata.formats.evt.evt3:FORMAT",
    "nvsdata.formats.evt.evt2:FORMAT",
    "nvsdata.formats.evt.evt2:EVT21",
    "nvsdata.formats.dat:FORMAT",
    "nvsdata.formats.matlab:FORMAT",
    "nvsdata.formats.npy:FORMAT",
    "nvsdata.formats.npz:FORMAT",
    "nvsdata.formats.text:FORMAT",
    "nvsdata.formats.atis:FORMAT",
)


def _built_in(module: str, name: str) -> Any:
    return getattr(import_module(module), name)


class _Formats(Registry[Format]):
    """Formats by name; those of nvsdata are imported when a file is first opened or written."""

    _complete = False  # whether nvsdata's own formats were imported

    def loaded(self) -> Iterable[Format]:
        if not self._complete:
            found: list[Format] = [_built_in(*name.split(":")) for name in BUILT_IN]
            # in one assignment, because other threads may read `_known`
            self._known = {**{one.name: one for one in found}, **self._known}
            self._complete = True
        return super().loaded()

    def _origin(self, thing: Any) -> object:
        return super()._origin(thing.open)

    def register(self, name: str, thing: Format) -> Format:
        self.loaded()
        return super().register(name, thing)

    def _load(self) -> None:
        self.loaded()
        super()._load()


FORMATS = _Formats("format", "formats", lambda _, found: register_format(found))


def register_format(added: Format) -> Format:
    """Register a format for `open`, `read`, `write` and all commands.

    An installed package registers a format by an entry point of the group `nvsdata.formats` whose object is a `Format`.

    Args:
        added: The format. Formats that were registered earlier are tried first.

    Returns:
        The format.

    Raises:
        ValueError: If the name is taken.
        TypeError: If `added` isn't a Format.

    Example:
        >>> from nvsdata.formats import text
        >>> register_format(Format("notes", (".note",), text.TextRecording))  # doctest: +SKIP
    """
    if not isinstance(added, Format):
        raise TypeError(f"register_format takes a Format, not {added!r}")
    return FORMATS.register(added.name, added)


def lacking_packages() -> set[str]:
    """Return the extensions of formats of which some files need a package that isn't installed.

    Example:
        >>> lacking_packages() <= set(suffixes())
        True
    """
    lacking = [one for one in FORMATS.loaded() if any(find_spec(package) is None for package in one.packages)]
    return {suffix for one in lacking for suffix in one.suffixes}


def split_stream(path: str) -> tuple[str, str]:
    """Split `stereo.bag#/dvs/left/events` into a file and the name of a stream in it; "" if the path names none."""
    file, mark, stream = path.partition("#/")
    return (file, "/" + stream) if mark and not os.path.lexists(path) and os.path.exists(file) else (path, "")


def format_of(path: str, head: bytes) -> Format:
    """Return the format of a file that begins with `head`, recognized by content first, by extension second.

    FormatError if no format fits.
    """
    if head.startswith(STORE):
        raise FormatError(path, "a packed store of many recordings: open it with its dataset's class")
    suffix = os.path.splitext(path)[1].lower()
    found = _marked(head)
    if found is None and FORMATS.load_installed():
        found = _marked(head)
    found = found or _likely(path, head, suffix)
    if found is not None:
        return found
    for known in FORMATS.loaded():
        if suffix in known.suffixes:
            what = "is empty" if not head else "doesn't begin like one: it is damaged, or has a wrong extension"
            raise FormatError(path, f"the extension means {known.name}, but the file {what}", offset=0)
    raise FormatError(
        path,
        "empty file of unknown format"
        if not head
        else "unknown format: neither the extension nor the first bytes are of a known one",
        offset=0,
    )


def _marked(head: bytes) -> Format | None:
    """Return the format whose `begins` recognizes a file that begins with `head`; None if there is none."""
    for one in FORMATS.loaded():
        begins = one.begins
        # inlined, because most of these functions take less time than a call does
        try:
            if begins is not None and begins(head):
                return one
        except Exception as error:  # a function of another package may raise anything
            _warn(one, error)
    return None


def _likely(path: str, head: bytes, suffix: str) -> Format | None:
    """Return the format of a file without a signature, by its extension or by `looks_like`; None if none fits."""
    known = FORMATS.loaded()
    for one in known:
        if one.begins is None and suffix in one.suffixes:
            return one
    if not head:
        return None
    for one in known:
        # a format with a signature, which this file doesn't have, is tried only for its own extensions
        tried = one.begins is None or suffix in one.suffixes
        if tried and _seems(one, head, os.path.getsize(path)):
            return one
    return None


def _seems(one: Format, head: bytes, size: int) -> bool:
    """Return whether a file looks like one of a format; False, with a warning, if `looks_like` raises."""
    try:
        return one.looks_like is not None and bool(one.looks_like(head, size))
    except Exception as error:  # a function of another package may raise anything
        _warn(one, error)
        return False


def _warn(one: Format, error: Exception) -> None:
    reason = f"{type(error).__name__}: {shown(error)}"
    warnings.warn(f"the format {one.name!r} failed to check whether a file is of this format: {reason}", stacklevel=5)


def writer_of(path: str | os.PathLike[str], format: str | None = None) -> Format:
    """Return the format in which a new file is written.

    Args:
        path: The file, whose extension selects the format.
        format: Name of the format, if the extension has several (default: the first one, EVT3 for `.raw`).

    Raises:
        ValueError: If no format with that extension and name can be written.

    Example:
        >>> writer_of("a.raw", None).name
        'evt3'
    """
    suffix = Path(path).suffix.lower()
    for _ in range(2):
        for one in FORMATS.loaded():
            if suffix in one.suffixes and one.write is not None and format in (None, one.name):
                return one
        FORMATS.load_installed()
    written = [one for one in FORMATS.values() if one.write is not None]
    if format is not None:
        known = ", ".join(f"{one.name} ({', '.join(one.suffixes)})" for one in written)
        raise ValueError(f"{path}: can't write a file with {suffix!r} as {format!r}; known are {known}")
    known = ", ".join(dict.fromkeys(s for one in written for s in one.suffixes))
    raise ValueError(f"{path}: can't write files with the extension {suffix!r}; known are {known}")


def suffixes() -> tuple[str, ...]:
    """Return the extensions of all formats, each once, in lower case with their dot.

    Example:
        >>> ".aedat4" in suffixes()
        True
    """
    return tuple(dict.fromkeys(suffix for one in FORMATS.values() for suffix in one.suffixes))
