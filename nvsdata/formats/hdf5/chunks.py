"""Values of HDF5 datasets. Compressed chunks may not expand to more than the chunk size that the file states.

The HDF5 library allocates memory for whatever a chunk expands to, and keeps it, so that a file of a few MB can take
gigabytes. So this module decompresses deflated chunks itself, which is faster, too. The library decodes other
compressions and layouts.
"""

from __future__ import annotations

import math
import zlib
from itertools import product
from typing import Any

import h5py
import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.formats.contents import fast_zlib
from nvsdata.formats.hdf5.file import name_of

SHUFFLE, DEFLATE, CHECKSUM = h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_FLETCHER32
OURS = ([DEFLATE], [SHUFFLE, DEFLATE])  # lists of filters that this module undoes, in the order of writing
# filters that can expand a chunk; at most one of them is allowed: the library's own, then bzip2, Blosc, LZ4, Zstandard
# and Blosc2
EXPANDING = (DEFLATE, h5py.h5z.FILTER_SZIP, h5py.h5z.FILTER_LZF, 307, 32001, 32004, 32015, 32026)
SPARE = 1024  # bytes that filters may add to a chunk

Offset = tuple[int, ...]


class Chunks:
    """The values of a dataset of h5py; the last decompressed chunk is cached."""

    def __init__(self, path: Any, dataset: Any) -> None:
        self.path, self.dataset = path, dataset
        layout = dataset.id.get_create_plist()
        self._filters: list[int] = []
        if layout.get_layout() == h5py.h5d.CHUNKED:
            self._filters = [layout.get_filter(i)[0] for i in range(layout.get_nfilters())]
        self._deflated = DEFLATE in self._filters
        after = self._filters[self._filters.index(DEFLATE) + 1 :] if self._deflated else []
        if sum(kind in EXPANDING for kind in self._filters) > 1 or not {CHECKSUM}.issuperset(after):
            raise FormatError(path, f"{name_of(dataset.id)} is compressed more than once, or filtered after that")
        self._last: tuple[Offset, np.ndarray] | None = None
        if self._deflated:
            self._kind, self._shape, self._sides = dataset.dtype, dataset.shape, layout.get_chunk()
            self._size = math.prod(self._sides) * self._kind.itemsize
            plain = self._kind.kind in "iufbV" and not self._kind.hasobject and self._filters in OURS
            self._ours = plain and dataset.id.get_type().equal(h5py.h5t.py_create(self._kind, logical=True))

    def read(self, lo: int = 0, hi: int | None = None) -> np.ndarray:
        """Return rows lo..hi, all by default. FormatError if a chunk expands to more bytes than the file states."""
        if not self.dataset.ndim:
            return np.asarray(self.dataset[()])
        found = self._inflated(lo, self.dataset.shape[0] if hi is None else hi) if self._deflated else None
        return np.asarray(self.dataset[lo:hi]) if found is None else found

    def _inflated(self, lo: int, hi: int) -> np.ndarray | None:
        """Return rows lo..hi; None if the HDF5 library must decode them."""
        first, last = min(lo, self._shape[0]), min(hi, self._shape[0])
        rows = np.empty((max(last - first, 0), *self._shape[1:]), self._kind)
        height, *sides = self._sides
        begins = [range(0, side, chunk) for side, chunk in zip(self._shape[1:], sides, strict=True)]
        sound = True
        for place in product(range(first // height * height, last, height), *begins):
            chunk = self._chunk(place)
            if chunk is None:
                sound = False
            elif sound:
                begin, *others = place
                a, b = max(begin, first), min(begin + height, last)
                across = [
                    slice(at, min(at + side, end)) for at, side, end in zip(others, sides, self._shape[1:], strict=True)
                ]
                part = chunk[a - begin : b - begin]
                rows[(slice(a - first, b - first), *across)] = part[
                    (slice(None), *(slice(where.stop - where.start) for where in across))
                ]
        return rows if sound else None

    def _chunk(self, place: Offset) -> np.ndarray | None:
        """Return the values of the chunk at `place`; None if the HDF5 library must decode it or report damage."""
        if self._last is not None and self._last[0] == place:
            return self._last[1]
        mask, data = self.dataset.id.read_direct_chunk(place)
        at = self._filters.index(DEFLATE)
        if mask >> at & 1:
            return None
        try:
            inflater = fast_zlib.decompressobj()
            raw = inflater.decompress(data, self._size + SPARE + 1)
        except fast_zlib.error:
            # zlib, which the HDF5 library uses, decompresses some data that isal can't
            inflater = zlib.decompressobj()
            try:
                raw = inflater.decompress(data, self._size + SPARE + 1)
            except zlib.error:
                return None
        if len(raw) > self._size + SPARE:
            where = f"a chunk of {name_of(self.dataset.id)} at {', '.join(map(str, place))}"
            raise FormatError(self.path, f"{where} expands to more than its {self._size} bytes")
        if mask or not self._ours or not inflater.eof or len(raw) != self._size:
            return None
        if SHUFFLE in self._filters and self._kind.itemsize > 1:
            shuffled = np.frombuffer(raw, np.uint8).reshape(self._kind.itemsize, -1)
            raw = np.ascontiguousarray(shuffled.T).data
        chunk = np.frombuffer(raw, self._kind).reshape(self._sides)
        self._last = place, chunk
        return chunk


def values_of(path: Any, dataset: Any) -> np.ndarray:
    """Return all values of a dataset, as `Chunks` reads them."""
    return Chunks(path, dataset).read()
