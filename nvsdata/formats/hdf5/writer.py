"""Writer of nvsdata's own HDF5 files; `nvsdata.formats.hdf5.layouts` documents their layout."""

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
DEFLATED = 1 << 14  # events per chunk of a compressed file; a window decodes entire chunks
CONTIGUOUS = 8  # chunks; up to this number, the columns are collected in memory and written contiguously
SHORT = 1 << 32  # µs; the range of uint32


def write(pieces: Pieces, path: Path, *, compressed: bool = False) -> None:
    """Write events, frames, inertial samples and metadata to a new HDF5 file.

    Columns of events are contiguous if they are short; otherwise they are written in chunks while pieces arrive.

    Args:
        pieces: The events.
        path: The file.
        compressed: Whether columns are always in chunks, whose bytes are shuffled and deflated, which every HDF5
            library can read (default False).
    """
    width, height = pieces.sensor_size
    with created(path) as (file, disk):
        others = SampleWriter(file, disk.check)
        chunks = _of_one_size(others.passing(pieces), DEFLATED if compressed else CHUNK)
        most = 0 if compressed else CONTIGUOUS
        waiting = list(islice(chunks, most + 1)) or [Columns.empty(0)]
        clock, offset = _clock(waiting)
        kinds = {"t": clock, "x": _coordinate(width), "y": _coordinate(height), "p": np.uint8}
        file.attrs.update(format=np.bytes_(NAME), version=VERSION, width=width, height=height)
        if len(waiting) > most:
            writer = ChunkWriter(file, max(waiting[0].t.size, 1), compressed)
            with flushed_early(path):
                offset = _write_chunks(writer, disk.check, chain(waiting, chunks), kinds, offset)
        else:
            for name, column in zip(kinds, _stored(concatenate(waiting), kinds, offset), strict=True):
                file.create_dataset(f"events/{name}", data=column)
        if offset:
            file["t_offset"] = np.int64(offset)
        file.attrs.update(start=np.int64(pieces.start), end=np.int64(pieces.end))
        others.finish()


def _coordinate(side: int) -> Any:
    """Return the type in which coordinates below `side` are stored."""
    return np.uint8 if side <= 256 else np.int16


def _clock(pieces: Sequence[Columns]) -> tuple[Any, int]:
    """Return the type in which times are stored, and the µs that are subtracted from them, 0 if possible."""
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
    """Writer of chunks to a file.

    Args:
        file: File of h5py.
        length: Events per chunk.
        compressed: Whether chunks are compressed.
    """

    file: Any
    length: int
    compressed: bool

    def create(self, name: str, kind: Any) -> Any:
        """Create a column that can grow."""
        how = {"shuffle": True, "compression": "gzip"} if self.compressed else {}
        shape = {"shape": (0,), "maxshape": (None,), "chunks": (self.length,)}
        return self.file.create_dataset(f"events/{name}", dtype=kind, fillvalue=0, **shape, **how)

    def add(self, dataset: Any, count: int, values: np.ndarray) -> None:
        """Append a chunk to a column of `count` values; only the last chunk may be shorter."""
        dataset.resize((count + values.size,))
        if values.size < self.length:
            values = np.concatenate((values, np.zeros(self.length - values.size, values.dtype)))
        chunk = np.ascontiguousarray(values)
        # written directly, because the HDF5 library would copy the chunk, and compress it slowly
        dataset.id.write_direct_chunk((count,), deflated(chunk) if self.compressed else chunk)


def _write_chunks(
    writer: ChunkWriter, check: Callable[[], None], pieces: Iterable[Columns], kinds: dict[str, Any], offset: int
) -> int:
    """Write pieces of a chunk each, and `check` the disk after each; return the µs to add to the stored times."""
    datasets = {name: writer.create(name, kind) for name, kind in kinds.items()}
    count, starts = 0, []
    for piece in pieces:
        if not piece.t.size:
            continue
        if kinds["t"] == np.uint32 and int(piece.t[-1]) - offset >= SHORT:
            datasets["t"] = _widened(writer, offset)
            kinds, offset = {**kinds, "t": np.int64}, 0
        for values, dataset in zip(_stored(piece, kinds, offset), datasets.values(), strict=True):
            writer.add(dataset, count, values)
        check()
        count += piece.t.size
        starts.append(int(piece.t[0]))
    if writer.compressed:
        writer.file.create_dataset("events/starts", data=np.array(starts, np.int64))
    return offset


def _widened(writer: ChunkWriter, offset: int) -> Any:
    """Convert the column of times to int64 for a recording that exceeds the range of uint32; return the new column."""
    narrow, wide = writer.file["events/t"], writer.create("wide", np.int64)
    for start in range(0, narrow.size, writer.length):
        writer.add(wide, start, narrow[start : start + writer.length].astype(np.int64) + offset)
    del writer.file["events/t"]
    writer.file.move("events/wide", "events/t")
    return wide


def _of_one_size(pieces: Iterable[Events], length: int) -> Iterator[Columns]:
    """Yield the same events in pieces of `length`; only the last may be shorter."""
    buffer, filled = Columns.empty(length), 0
    for piece in pieces:
        rest = piece.columns
        while rest.t.size:
            part = rest.first(length - filled)
            rest = rest.take(slice(part.t.size, None))
            if part.t.size == length:
                yield part
                continue
            for values, place in zip(part, buffer, strict=True):
                place[filled : filled + values.size] = values
            filled += part.t.size
            if filled == length:
                yield buffer
                buffer, filled = Columns.empty(length), 0
    if filled:
        yield buffer.first(filled)


def deflated(values: np.ndarray) -> bytes:
    """Shuffle values (all first bytes, then all second bytes, and so on) and compress them as a stream of zlib."""
    shuffled = values.view(np.uint8).reshape(-1, values.itemsize).T
    # higher levels don't compress better, because only single bytes repeat
    return bytes(fast_zlib.compress(np.ascontiguousarray(shuffled), 1))
