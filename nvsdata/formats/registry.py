"""The known formats, and how a file's format is recognized."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from nvsdata.common.errors import FormatError, shown
from nvsdata.common.registry import Registry
from nvsdata.data.recording import Recording
from nvsdata.formats.writing import Pieces


@dataclass(eq=False)
class Format:
    """How files of a format are recognized, opened and written.

    - `name`: the name that `nvsdata info` shows
    - `suffixes`: extensions in lower case with their dot; the first is for new files
    - `open(path, sensor_size, head, strict)`: gives the `Recording` of a file. `head`: its first 64 KiB, or the whole
      file if that is shorter
    - `begins(head)`: whether a file that begins with `head` is certainly of this format; None, the default, for a
      format without a mark of its own
    - `looks_like(head, size)`: whether a file of `size` bytes that begins with `head` could be of this format; called
      if neither a mark nor an extension decides. Default None
    - `write(pieces, path)`: writes a new file; None, the default, for a format that is only read
    - `holds_samples`: whether files hold frames and inertial samples; default False
    """

    name: str
    suffixes: tuple[str, ...]
    open: Callable[[str, tuple[int, int] | None, bytes, bool], Recording]
    begins: Callable[[bytes], Any] | None = None
    looks_like: Callable[[bytes, int], bool] | None = None
    write: Callable[[Pieces, Path], None] | None = None
    holds_samples: bool = False


def starts_with(mark: bytes) -> Callable[[bytes], bool]:
    """A test `begins` for a format whose files begin with `mark`."""
    return lambda head: head.startswith(mark)


# nvsdata's own formats, named as entry points are; if several fit a file, the first is taken
BUILT_IN = (
    "nvsdata.formats.hdf5:FORMAT",
    "nvsdata.formats.hdf5:COMPRESSED",
    "nvsdata.recording.davis.file:FORMAT",
    "nvsdata.formats.aedat.aedat2:FORMAT",
    "nvsdata.formats.aedat.aedat1:FORMAT",
    "nvsdata.formats.aedat.aedat3:FORMAT",
    "nvsdata.formats.aedat.aedat4:FORMAT",
    "nvsdata.formats.evt.evt3:FORMAT",
    "nvsdata.formats.evt.evt2:FORMAT",
    "nvsdata.formats.evt.evt2:EVT21",
    "nvsdata.formats.dat:FORMAT",
    "nvsdata.formats.matlab:FORMAT",
    "nvsdata.formats.npy:FORMAT",
    "nvsdata.formats.text:FORMAT",
    "nvsdata.formats.atis:FORMAT",
)


def _built_in(module: str, name: str) -> Any:
    return getattr(import_module(module), name)


class _Formats(Registry[Format]):
    """The formats by name; nvsdata's own are imported when a file is first opened or written."""

    _complete = False  # whether nvsdata's own are among those known

    def loaded(self) -> Iterable[Format]:
        if not self._complete:
            found: list[Format] = [_built_in(*name.split(":")) for name in BUILT_IN]
            # at once: other threads may look meanwhile
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
    """Make a format known to `open`, `read`, `write` and all commands; returns it.

    - `added`: the format; formats registered before it are tried first

    A package registers one by an entry point of the group `nvsdata.formats` whose object is a `Format`.

    Raises ValueError for a name that is taken, TypeError for anything but a Format.
    """
    if not isinstance(added, Format):
        raise TypeError(f"register_format takes a Format, not {added!r}")
    return FORMATS.register(added.name, added)


def format_of(path: str, head: bytes) -> Format:
    """The format of a file that begins with `head`: recognized by content first, by extension second.

    FormatError if no format fits.
    """
    suffix = os.path.splitext(path)[1].lower()
    found = _marked(head)
    if found is None and FORMATS.load_installed():
        found = _marked(head)
    found = found or _likely(path, head, suffix)
    if found is not None:
        return found
    for known in FORMATS.loaded():
        if suffix in known.suffixes:
            what = "is empty" if not head else "does not begin as one"
            raise FormatError(path, f"the extension says {known.name}, but the file {what}", offset=0)
    raise FormatError(path, "empty file of unknown format" if not head else "unknown format", offset=0)


def _marked(head: bytes) -> Format | None:
    """The format whose mark a file begins with."""
    for one in FORMATS.loaded():
        begins = one.begins
        # most tests are one comparison, which another call would outweigh
        try:
            if begins is not None and begins(head):
                return one
        except Exception as error:  # a test of somebody else's format may raise anything
            _warn(one, error)
    return None


def _likely(path: str, head: bytes, suffix: str) -> Format | None:
    """The format of a file without a mark, by its extension or by what it looks like."""
    known = FORMATS.loaded()
    for one in known:
        if one.begins is None and suffix in one.suffixes:
            return one
    if not head:
        return None
    for one in known:
        # without its mark, a format is tried only if the extension is one of its own
        asked = one.begins is None or suffix in one.suffixes
        if asked and _seems(one, head, os.path.getsize(path)):
            return one
    return None


def _seems(one: Format, head: bytes, size: int) -> bool:
    """Whether a file looks like one of a format; a test that raises says no, with a warning."""
    try:
        return one.looks_like is not None and bool(one.looks_like(head, size))
    except Exception as error:  # a test of somebody else's format may raise anything
        _warn(one, error)
        return False


def _warn(one: Format, error: Exception) -> None:
    reason = f"{type(error).__name__}: {shown(error)}"
    warnings.warn(f"the format {one.name!r} can't tell whether a file is one of its own: {reason}", stacklevel=5)


def writer_of(path: str | os.PathLike[str], format: str | None = None) -> Format:
    """The format in which a new file `path` is written.

    - `format`: its name; default: by the extension, EVT3 for `.raw`

    ValueError if no format with that extension and name can be written.
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
    raise ValueError(f"{path}: can't tell a format to write from {suffix!r}; known are {known}")


def suffixes() -> tuple[str, ...]:
    """Extensions of all formats that can be opened, each once: lower case, with their dot."""
    return tuple(dict.fromkeys(suffix for one in FORMATS.values() for suffix in one.suffixes))
