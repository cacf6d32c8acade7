"""Safe access to HDF5 files: attributes, and datasets all of whose values are in the file itself.

HDF5 can refer to other files by external links, virtual datasets and external storage. By such references, a file could
expose any file of the machine, wait forever on a pipe, or claim values that don't exist. They are refused, unless the
environment has NVSDATA_HDF5_LINKS=1: then the HDF5 library follows them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import h5py
import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.formats.contents import Allowance, most_bytes
from nvsdata.formats.hdf5.filters import ECF

FOLLOW = "NVSDATA_HDF5_LINKS"
MOST_LINKS = 16  # soft links in one path


@contextmanager
def opened(path: Any, reason: str) -> Iterator[Any]:
    """Open a file with h5py for reading. Any error while it is open becomes a FormatError that begins with `reason`."""
    try:
        with h5py.File(path, "r") as file:
            yield file
    except FormatError:
        raise
    except (OSError, KeyError, RuntimeError, TypeError, ValueError, ArithmeticError, MemoryError) as error:
        raise FormatError(path, f"{reason}: {error}") from error


def attribute(file: Any, name: str) -> Any:
    """Return an attribute of a file; None if it is missing. Takes a third of the time of h5py's `attrs`."""
    if not h5py.h5a.exists(file.id, name.encode()):
        return None
    found = h5py.h5a.open(file.id, name.encode())
    if found.shape is None:
        return None
    value = np.empty(found.shape, found.dtype)
    found.read(value)
    return value[()]


def text_of(file: Any, name: str) -> str:
    """Return a string attribute of a file; empty if it is missing."""
    value = attribute(file, name)
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return "" if value is None else str(value)


def number_of(path: Any, file: Any, name: str) -> int:
    """Return an integer attribute of a file. FormatError if it is missing."""
    value = np.asarray(attribute(file, name))
    if value.size != 1 or value.dtype.kind not in "iuf" or value.item() % 1 != 0:
        raise FormatError(path, f"attribute {name} is {value}, not a whole number")
    return int(value.item())


def check_version(path: Any, file: Any, known: int) -> None:
    """Raise FormatError for a file of a newer version than `known`."""
    version = number_of(path, file, "version")
    if version > known:
        raise FormatError(path, f"version {version} is newer than {known}: update nvsdata")


def links_are_followed() -> bool:
    """Return whether the user allowed references to other files."""
    return os.environ.get(FOLLOW) == "1"


def found_in(path: Any, place: Any, name: str) -> Any:
    """Return the object called `name` in a file or a group, as an object of h5py's low-level API; None if missing.

    Soft links, which refer to names in the same file, are followed. FormatError for links to other files.
    """
    at = place if isinstance(place, h5py.h5g.GroupID) else h5py.h5g.open(place, b"/")
    waiting = name.encode().split(b"/")[::-1]
    links = 0
    while waiting:
        part = waiting.pop()
        if part in (b"", b"."):
            continue
        if not isinstance(at, h5py.h5g.GroupID) or not at.links.exists(part):
            return None
        kind = at.links.get_info(part).type
        if kind == h5py.h5l.TYPE_SOFT:
            links += 1
            if links > MOST_LINKS:
                raise FormatError(path, f"{name} has a cycle of soft links, or more than {MOST_LINKS} of them")
            target = at.links.get_val(part)
            at = h5py.h5g.open(place, b"/") if target.startswith(b"/") else at
            waiting.extend(target.split(b"/")[::-1])
            continue
        if kind != h5py.h5l.TYPE_HARD and not links_are_followed():
            where = b":".join(at.links.get_val(part)) if kind == h5py.h5l.TYPE_EXTERNAL else b"an unknown target"
            full = f"{name_of(at).rstrip('/')}/{part.decode('utf-8', 'replace')}"
            raise _elsewhere(path, full, f"an external link to {where.decode('utf-8', 'replace')!r}")
        at = h5py.h5o.open(at, part)
    return at


def dataset_of(path: Any, file: Any, name: str, left: Allowance | None = None) -> Any:
    """Return the dataset called `name` in an open h5py file. FormatError unless all its values are in the file.

    The dataset's bytes are subtracted from `left`, a limit of decompression that several datasets may share.
    """
    found = found_in(path, file.id, name)
    if not isinstance(found, h5py.h5d.DatasetID):
        raise FormatError(path, f"/{name} is not a dataset" if found is not None else f"there is no /{name}")
    check_stored(path, found, left)
    return h5py.Dataset(found)


def name_of(thing: Any) -> str:
    """Return the full name of an object of h5py's low-level API in its file."""
    name: str = h5py.h5i.get_name(thing).decode("utf-8", "replace")
    return name


def check_stored(path: Any, dataset: Any, left: Allowance | None = None) -> tuple[Any, tuple[int, ...]]:
    """Check that a dataset of h5py's low-level API is safe to read; return its creation properties and shape.

    FormatError if its values aren't all in the file: HDF5 itself fills in values that were never written, however many,
    and follows every reference to other files. The dataset's bytes are subtracted from `left`, a limit of decompression
    that several datasets may share.
    """
    layout = dataset.get_create_plist()
    kind = layout.get_layout()
    if kind == h5py.h5d.VIRTUAL or (kind == h5py.h5d.CONTIGUOUS and layout.get_external_count()):
        # checked before the shape is queried, because that opens the other files
        if not links_are_followed():
            how = "virtual" if kind == h5py.h5d.VIRTUAL else "stored externally"
            raise _elsewhere(path, name_of(dataset), how)
        return layout, dataset.shape
    shape = dataset.shape
    claimed = found = 1
    size = dataset.dtype.itemsize
    if kind == h5py.h5d.CHUNKED:
        claimed = math.prod(-(-side // chunk) for side, chunk in zip(shape, layout.get_chunk(), strict=True))
        found = dataset.get_num_chunks()
        size *= math.prod(layout.get_chunk())
    else:
        size *= math.prod(shape)
        if kind == h5py.h5d.CONTIGUOUS and size:
            found = int(dataset.get_offset() is not None)
    if found < claimed:
        what = f"{found} of {claimed} pieces of {name_of(dataset)} are there"
        raise FormatError(path, f"{what}: cut off, or never written")
    file_size = os.path.getsize(path)
    most = most_bytes(file_size) if kind == h5py.h5d.CHUNKED else file_size
    if size * claimed > most:
        what = f"{name_of(dataset)} claims {size * claimed} bytes"
        raise FormatError(path, f"{what}; a file of {file_size} bytes may expand to {most} at most")
    if kind == h5py.h5d.CHUNKED and left is not None:
        try:
            left.take(size * claimed)
        except ValueError as error:
            raise FormatError(path, f"{name_of(dataset)} {error}") from None
    _check_filters(path, dataset, layout)
    return layout, shape


def _check_filters(path: Any, dataset: Any, layout: Any) -> None:
    """Raise an error if a dataset is compressed by a filter that isn't installed, except ECF, which `Chunks` undoes.

    ImportError if installing hdf5plugin may help; FormatError if it is installed, and doesn't have the filter.
    """
    for i in range(layout.get_nfilters()):
        code, *_ = layout.get_filter(i)
        if code == ECF or h5py.h5z.filter_avail(code):
            continue
        how = f"{name_of(dataset)} is compressed by filter {code}, which isn't installed"
        try:
            import hdf5plugin  # noqa: F401  registers its filters
        except ImportError:
            raise ImportError(f"{path}: {how}: pip install 'nvsdata[hdf5]' installs the usual filters") from None
        if not h5py.h5z.filter_avail(code):
            raise FormatError(path, f"{how}, and isn't one of hdf5plugin's")


def places_of(dataset: Any, layout: Any, count: int) -> tuple[list[int], int]:
    """Return the offsets at which an uncompressed dataset of `count` values is stored, and how many values each has.

    ([], 0) if the HDF5 library must read the dataset.
    """
    if links_are_followed() or layout.get_nfilters() or not count:
        return [], 0
    offset = dataset.get_offset()
    if offset is not None:
        return [offset], count
    if layout.get_layout() != h5py.h5d.CHUNKED:
        return [], 0
    (length,) = layout.get_chunk()
    size = length * dataset.dtype.itemsize
    found: dict[int, int] = {}
    # a chunk of another size is left to `Chunks`, which names it
    dataset.chunk_iter(
        lambda chunk: found.update({chunk.chunk_offset[0]: chunk.byte_offset}) if chunk.size == size else None
    )
    places = [found[first] for first in range(0, count, length) if first in found]
    return (places, length) if len(places) == -(-count // length) else ([], 0)


def _elsewhere(path: Any, name: str, what: str) -> FormatError:
    return FormatError(path, f"{name} is {what}: other files are read only with {FOLLOW}=1 in the environment")
