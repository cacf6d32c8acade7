"""Writing nvsdata's own HDF5 files; `nvsdata.formats.hdf5` documents their layout."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.common.files import flushed_early
from nvsdata.data.events import Columns, Events, concatenate
from nvsdata.formats.hdf5_disk import created
from nvsdata.formats.hdf5_samples import Beside
from nvsdata.formats.writing import Pieces

NAME, VERSION = "nvsdata-events", 1
CHUNK = 1 << 18  # events per chunk of a long file
CONTIGUOUS = 8  # chunks; up to this number, the columns are kept in memory and written whole
SHORT = 1 << 32  # µs that uint32 can represent


def write(pieces: Pieces, path: Path) -> None:
    """Write the four columns: contiguous if they are short, else in chunks as they come. Never compressed."""
    width, height = pieces.sensor_size
    with created(path) as (file, disk):
        beside = Beside(file, disk.check)
        chunks = _of_one_size(beside.passing(pieces))
        waiting = list(islice(chunks, CONTIGUOUS + 1)) or [Columns.empty(0)]
        clock, offset = _clock(waiting)
        kinds = {"t": clock, "x": _coordinate(width), "y": _coordinate(height), "p": np.uint8}
        file.attrs.update(format=np.bytes_(NAME), version=VERSION, width=width, height=height)
        if len(waiting) > CONTIGUOUS:
            with flushed_early(path):
                offset = _write_chunks(file, disk.check, chain(waiting, chunks), kinds, offset)
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


def _write_chunks(
    file: Any, check: Callable[[], None], pieces: Iterable[Columns], kinds: dict[str, Any], offset: int
) -> int:
    """Write pieces of `CHUNK` events, and `check` the disk after each; returns the µs subtracted from all times."""
    datasets = {name: _endless(file, name, kind) for name, kind in kinds.items()}
    count = 0
    for piece in pieces:
        if kinds["t"] == np.uint32 and int(piece.t[-1]) - offset >= SHORT:
            datasets["t"] = _widened(file, offset)
            kinds, offset = {**kinds, "t": np.int64}, 0
        for values, dataset in zip(_stored(piece, kinds, offset), datasets.values(), strict=True):
            dataset.resize((count + values.size,))
            # directly, because the library's usual path would copy
            whole = (
                values
                if values.size == CHUNK
                else np.concatenate((values, np.zeros(CHUNK - values.size, values.dtype)))
            )
            dataset.id.write_direct_chunk((count,), np.ascontiguousarray(whole))
        check()
        count += piece.t.size
    return offset


def _endless(file: Any, name: str, kind: Any) -> Any:
    return file.create_dataset(f"events/{name}", (0,), kind, maxshape=(None,), chunks=(CHUNK,), fillvalue=0)


def _widened(file: Any, offset: int) -> Any:
    """The column of times converted to int64, because the recording is longer than uint32 can represent."""
    narrow, wide = file["events/t"], _endless(file, "wide", np.int64)
    wide.resize(narrow.shape)
    for start in range(0, narrow.size, CHUNK):
        wide[start : start + CHUNK] = narrow[start : start + CHUNK].astype(np.int64) + offset
    del file["events/t"]
    file.move("events/wide", "events/t")
    return wide


def _of_one_size(pieces: Iterable[Events]) -> Iterator[Columns]:
    """The same events in pieces of `CHUNK`; only the last may be shorter."""
    room, filled = Columns.empty(CHUNK), 0
    for piece in pieces:
        rest = piece.columns
        while rest.t.size:
            part = rest.first(CHUNK - filled)
            rest = rest.take(slice(part.t.size, None))
            if part.t.size == CHUNK:
                yield part
                continue
            for values, place in zip(part, room, strict=True):
                place[filled : filled + values.size] = values
            filled += part.t.size
            if filled == CHUNK:
                yield room
                room, filled = Columns.empty(CHUNK), 0
    if filled:
        yield room.first(filled)
