"""Values of HDF5 datasets. Each chunk must expand to exactly the chunk size that the file states.

The HDF5 library trusts a file: it allocates memory for whatever a chunk expands to, so that a file of a few MB can take
gigabytes, and if a chunk is shorter than stated, it reads the memory behind it. So this module decompresses chunks
itself where it can, which is faster, too. For the other compressions, it determines the size before the library
decodes a chunk.
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import product
from typing import Any

import h5py
import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.formats.hdf5.file import name_of
from nvsdata.formats.hdf5.filters import CHECKSUM, ECF, EXPANDED, KNOWN, SAME_SIZE, SHUFFLE, expanded_size, filters_of
from nvsdata.kernels.decode.ecf import EVENT

CHECKSUM_BYTES = 4

Offset = tuple[int, ...]


class Chunks:
    """The values of a dataset of h5py. The last chunk is cached, and the last rows of a table, for all its fields."""

    def __init__(self, path: Any, dataset: Any) -> None:
        self.path, self.dataset = path, dataset
        self._kind, self._shape = dataset.dtype, dataset.shape
        self._rows: tuple[int, np.ndarray] | None = None
        layout = dataset.id.get_create_plist()
        self._chunked = layout.get_layout() == h5py.h5d.CHUNKED
        if not self._chunked:
            return
        filters = filters_of(layout)
        self._filters, self._settings = [kind for kind, _ in filters], dict(filters)
        self._check_filters()
        self._sides, in_file = layout.get_chunk(), dataset.id.get_type()
        # rows of a table are copied whole, because NumPy copies them field by field
        self._whole = self._kind if self._kind.names is None else np.dtype((np.void, self._kind.itemsize))
        self._size = math.prod(self._sides) * in_file.get_size()
        self._last: tuple[Offset, np.ndarray] | None = None
        self._checked: set[Offset] = set()
        undone = any(kind in EXPANDED for kind in self._filters) and {SHUFFLE, *EXPANDED}.issuperset(self._filters)
        plain = self._kind.kind in "iufbV" and not self._kind.hasobject and self._kind.subdtype is None
        # otherwise the library must decode the values
        self._ours = undone and plain and in_file.equal(h5py.h5t.py_create(self._kind, logical=True))
        if ECF in self._filters and not (self._ours and self._filters == [ECF] and self._kind == EVENT):
            reason = f"{name_of(dataset.id)} is compressed by ECF, but isn't a table of events as Metavision writes it"
            raise FormatError(path, reason)

    def _check_filters(self) -> None:
        name = name_of(self.dataset.id)
        expanding = [i for i, kind in enumerate(self._filters) if kind not in {CHECKSUM, *SAME_SIZE}]
        if len(expanding) > 1 or (expanding and not {CHECKSUM}.issuperset(self._filters[expanding[0] + 1 :])):
            raise FormatError(self.path, f"{name} is compressed more than once, or filtered after that")
        if expanding and (kind := self._filters[expanding[0]]) not in KNOWN:
            reason = f"{name} is compressed by filter {kind}, which doesn't tell how far a chunk expands"
            raise FormatError(self.path, f"{reason}: compress the file by another one, for example with h5repack")

    def read(self, lo: int = 0, hi: int | None = None) -> np.ndarray:
        """Return rows lo..hi, all by default. FormatError if a chunk expands to another size than the file states."""
        if not self.dataset.ndim:
            return np.asarray(self.dataset[()])
        first, last = (min(row, self._shape[0]) for row in (lo, self._shape[0] if hi is None else hi))
        if self._kind.names is None:
            return self._read(first, last)
        if self._rows is None or not self._rows[0] <= first <= last <= self._rows[0] + len(self._rows[1]):
            self._rows = first, self._read(first, last)
        begin, rows = self._rows
        return rows[first - begin : last - begin]

    def _read(self, first: int, last: int) -> np.ndarray:
        if not self._chunked:
            return np.asarray(self.dataset[first:last])
        height, *sides = self._sides
        begins = [range(0, side, chunk) for side, chunk in zip(self._shape[1:], sides, strict=True)]
        places = product(range(first // height * height, last, height), *begins)
        if not self._ours:
            for place in places:
                self._check(place)
            return np.asarray(self.dataset[first:last])
        rows = np.empty((max(last - first, 0), *self._shape[1:]), self._whole)
        for place in places:
            begin, *others = place
            a, b = max(begin, first), min(begin + height, last)
            across = [
                slice(at, min(at + side, end)) for at, side, end in zip(others, sides, self._shape[1:], strict=True)
            ]
            inside = (slice(None), *(slice(where.stop - where.start) for where in across))
            rows[(slice(a - first, b - first), *across)] = self._chunk(place)[a - begin : b - begin][inside]
        return rows.view(self._kind)

    def _stored(self, place: Offset) -> tuple[list[int], bytes]:
        """Return the filters of a chunk, in the order of writing, and its bytes."""
        mask, data = self.dataset.id.read_direct_chunk(place)
        return [kind for i, kind in enumerate(self._filters) if not mask >> i & 1], data

    def _chunk(self, place: Offset) -> np.ndarray:
        """Return the values of a chunk that this module decodes."""
        if self._last is not None and self._last[0] == place:
            return self._last[1]
        raw: Any
        filters, raw = self._stored(place)
        stored = raw
        for kind in EXPANDED.keys() & filters:
            try:
                raw = EXPANDED[kind](stored, self._size + 1)
            except ValueError as error:
                if len(stored) != self._size or not self._is_partial(place):
                    raise self._error(place, f"is {error}") from None
                # HDF5 may leave chunks that reach beyond the values as they are
                filters = []
        # Metavision compresses only the events that are there
        self._compare(place, len(raw), self._least(place) if ECF in filters else self._size)
        if SHUFFLE in filters and self._kind.itemsize > 1:
            shuffled = np.frombuffer(raw, np.uint8).reshape(self._kind.itemsize, -1)
            raw = np.ascontiguousarray(shuffled.T).data
        chunk = np.frombuffer(raw, self._whole).reshape(-1, *self._sides[1:])
        self._last = place, chunk
        return chunk

    def _check(self, place: Offset) -> None:
        """Raise FormatError unless a chunk that the library decodes has the stated size."""
        if place in self._checked:
            return
        if self._filters:
            filters, data = self._stored(place)
            size = len(data)
        else:
            # without reading the values; `read_direct_chunk` would believe a false size
            filters, size = [], self._sizes.get(place, 0)
        for kind in reversed(filters):
            if kind == CHECKSUM:
                size = max(size - CHECKSUM_BYTES, 0)
            elif kind not in SAME_SIZE:
                try:
                    size = expanded_size(kind, self._settings[kind], data[:size], self._size + CHECKSUM_BYTES + 1)
                except ValueError as error:
                    raise self._error(place, f"is {error}") from None
                except (LookupError, ZeroDivisionError):
                    raise self._error(place, "is damaged: its header has no sizes") from None
        self._compare(place, size)
        self._checked.add(place)

    @cached_property
    def _sizes(self) -> dict[Offset, int]:
        """Sizes of all chunks: the library's search for a single one takes as long."""
        sizes: dict[Offset, int] = {}
        self.dataset.id.chunk_iter(lambda chunk: sizes.update({chunk.chunk_offset: chunk.size}))
        return sizes

    def _is_partial(self, place: Offset) -> bool:
        return any(at + side > end for at, side, end in zip(place, self._sides, self._shape, strict=True))

    def _least(self, place: Offset) -> int:
        """Return the number of bytes of a chunk up to the last value, if the values are a single column."""
        count = min(self._sides[0], self._shape[0] - place[0])
        return int(count * self._kind.itemsize) if len(self._sides) == 1 else self._size

    def _compare(self, place: Offset, size: int, least: int | None = None) -> None:
        """Raise FormatError unless a chunk expands to the stated size, or to at least as many bytes as are needed."""
        least = self._size if least is None else least
        if not least <= size <= self._size:
            found = f"more than its {self._size}" if size > self._size else f"{size} of its {least}"
            raise self._error(place, f"expands to {found} bytes")

    def _error(self, place: Offset, reason: str) -> FormatError:
        return FormatError(self.path, f"a chunk of {name_of(self.dataset.id)} at {', '.join(map(str, place))} {reason}")


def values_of(path: Any, dataset: Any) -> np.ndarray:
    """Return all values of a dataset, as `Chunks` reads them."""
    return Chunks(path, dataset).read()
