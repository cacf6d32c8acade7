"""Writing nvsdata's own HDF5 files; `nvsdata.formats.hdf5.layouts` documents their layout."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from nvsdata.common.files import flushed_early
from nvsdata.data.events import Columns, Events, concatenate
from nvsdata.formats.contents import fast_zlib
from nvsdata.formats.hdf5.disk import created
from nvsdata.formats.hdf5.samples import SampleWriter
from nvsdata.formats.writing import Pieces

NAME, VERSION = "nvsdata-events", 1
CHUNK = 1 << 18  # events per chunk of a long file
DEFLATED = 1 << 14  # events per chunk of a compressed file: a window decodes whole chunks
CONTIGUOUS = 8  # chunks; up to this number, the columns are kept in memory and written whole
SHORT = 1 << 32  # µs that uint32 can represent


def write(pieces: Pieces, path: Path, *, compressed: bool = False) -> None:
    """Write the four columns: contiguous if they are short, else in chunks as they come.

    - `compressed`: always in chunks, each with its bytes shuffled and deflated, which every HDF5 library can read
      (default False)
    """
    width, height = pieces.sensor_size
    with created(path) as (file, disk):
        beside = SampleWriter(file, disk.check)
        chunks = _of_one_size(beside.passing(pieces), DEFLATED if compressed else CHUNK)
        most = 0 if compressed else CONTIGUOUS
        waiting = list(islice(chunks, most + 1)) or [Columns.empty(0)]
        clock, offset = _clock(waiting)
        kinds = {"t": clock, "x": _coordinate(width), "y": _coordinate(height), "p": np.uint8}
        file.attrs.update(format=np.bytes_(NAME), version=VERSION, width=width, height=height)
        if len(waiting) > most:
            place = ChunkWriter(file, max(waiting[0].t.size, 1), compressed)
            with flushed_early(path):
                offset = _write_chunks(place, disk.check, chain(waiting, chunks), kinds, offset)
        else:
            for name, column in zip(kinds, _stored(concatenate(waiting), kinds, offset), strict=True):
                file.create_dataset(f"events/{name}", data=column)
        if offset:
            file["t_offset"] = np.int64(offset)
        file.attrs.update(start=np.int64(pieces.start), end=np.int64(pieces.end))
        beside.finish()


def _coordinate(side: int) -> Any:
    """The type in which coordinates below `side` are stored."""
    return np.uint8 if side <= 256 else np.int16


def _clock(pieces: Sequence[Columns]) -> tuple[Any, int]:
    """The type in which these times are stored, and the µs that are subtracted from them, 0 where possible."""
    if pieces[-1].t.size == 0:
        return np.uint32, 0
    first, last = int(pieces[0].t[0]), int(pieces[-1].t[-1])
    if first >= 0 and last < SHORT:
        return np.uint32, 0
    return (np.uint32, first) if last - first < SHORT else (np.int64, 0)


def _stored(columns: Columns, kinds: dict[str, Any], offset: int) -> list[np.ndarray]:
    t = columns.t - offset if offset else columns.t
    return [values.astype(kind, copy=False) for values, kind in zip((t, *columns[1:]), kinds.values(), strict=True)]


class ChunkWriter(NamedTuple):
    """Where chunks go: the file, events per chunk, and whether they are compressed."""

    file: Any
    length: int
    compressed: bool

    def endless(self, name: str, kind: Any) -> Any:
        """A new column that can grow."""
        how = {"shuffle": True, "compression": "gzip"} if self.compressed else {}
        shape = {"shape": (0,), "maxshape": (None,), "chunks": (self.length,)}
        return self.file.create_dataset(f"events/{name}", dtype=kind, fillvalue=0, **shape, **how)

    def add(self, dataset: Any, count: int, values: np.ndarray) -> None:
        """Append a chunk, of which only the last may be shorter, to a column of `count` values."""
        dataset.resize((count + values.size,))
        if values.size < self.length:
            values = np.concatenate((values, np.zeros(self.length - values.size, values.dtype)))
        whole = np.ascontiguousarray(values)
        # directly, because the library's usual path would copy, and compress slowly
        dataset.id.write_direct_chunk((count,), deflated(whole) if self.compressed else whole)


def _write_chunks(
    place: ChunkWriter, check: Callable[[], None], pieces: Iterable[Columns], kinds: dict[str, Any], offset: int
) -> int:
    """Write pieces that fill a chunk each, and `check` the disk after each; returns the µs subtracted from times."""
    datasets = {name: place.endless(name, kind) for name, kind in kinds.items()}
    count = 0
    for piece in pieces:
        if not piece.t.size:
            continue
        if kinds["t"] == np.uint32 and int(piece.t[-1]) - offset >= SHORT:
            datasets["t"] = _widened(place, offset)
            kinds, offset = {**kinds, "t": np.int64}, 0
        for values, dataset in zip(_stored(piece, kinds, offset), datasets.values(), strict=True):
            place.add(dataset, count, values)
        check()
        count += piece.t.size
    return offset


def _widened(place: ChunkWriter, offset: int) -> Any:
    """The column of times converted to int64, because the recording is longer than uint32 can represent."""
    narrow, wide = place.file["events/t"], place.endless("wide", np.int64)
    for start in range(0, narrow.size, place.length):
        place.add(wide, start, narrow[start : start + place.length].astype(np.int64) + offset)
    del place.file["events/t"]
    place.file.move("events/wide", "events/t")
    return wide


def _of_one_size(pieces: Iterable[Events], length: int) -> Iterator[Columns]:
    """The same events in pieces of `length`; only the last may be shorter."""
    room, filled = Columns.empty(length), 0
    for piece in pieces:
        rest = piece.columns
        while rest.t.size:
            part = rest.first(length - filled)
            rest = rest.take(slice(part.t.size, None))
            if part.t.size == length:
                yield part
                continue
            for values, place in zip(part, room, strict=True):
                place[filled : filled + values.size] = values
            filled += part.t.size
            if filled == length:
                yield room
                room, filled = Columns.empty(length), 0
    if filled:
        yield room.first(filled)


def deflated(values: np.ndarray) -> bytes:
    """Values with all their first bytes first, then all their second ones, and so on, as a stream of zlib."""
    apart = values.view(np.uint8).reshape(-1, values.itemsize).T
    # higher levels compress no better: what repeats is single bytes
    return bytes(fast_zlib.compress(np.ascontiguousarray(apart), 1))
