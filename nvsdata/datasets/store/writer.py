"""Packing of a dataset into a store: in parallel, resumable, and completely or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.batch.scheduler import in_order
from nvsdata.common.errors import shown
from nvsdata.common.files import atomic, creating, named
from nvsdata.common.progress import bar
from nvsdata.common.terminal import say
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.source import Source, path_below
from nvsdata.datasets.store.part import Part
from nvsdata.datasets.store.reader import COLUMNS, INDEX, MARKED, UNSTATED, VERSION, Store, checksum, crc_of, pack_texts
from nvsdata.formats.hdf5.disk import created
from nvsdata.formats.hdf5.layouts import STORE

COPIED = 1 << 24  # events copied at once
MOST_SIDE_BYTES = 1 << 24  # files that aren't recordings are left out if they are larger
NARROW = np.iinfo(np.uint32).max


@dataclass
class PackReport:
    """Result of `pack`.

    Attributes:
        packed: number of recordings in the store.
        events: number of events in them.
        skipped: recordings that were left out, name to reason.
    """

    packed: int = 0
    events: int = 0
    skipped: dict[str, str] = field(default_factory=dict)


def pack(
    dataset: EventDataset,
    out: str | os.PathLike[str],
    *,
    jobs: int = 1,
    compress: bool = False,
    overwrite: bool = False,
) -> PackReport:
    """Write the recordings of `dataset` and its small side files (lists, labels) into the store `out`.

    The dataset's class opens the store in place of a folder, with the same classes, splits and samples; a store of
    `split="all"` contains every split and fold. Recordings without events or with a FormatError are left out and
    reported; the store contains their names and the reasons. Frames and inertial samples aren't packed. Until the store
    is complete, the progress is kept in the folder `.OUT.part` next to it, from which an interrupted run continues.

    Args:
        dataset: the dataset; its transforms are not applied.
        out: path of the new file.
        jobs: number of processes that decode.
        compress: whether to compress the columns with gzip.
        overwrite: whether to replace an existing file.

    Returns:
        The number of recordings and events, and the recordings that were left out.

    Raises:
        FileExistsError: `out` exists, unless `overwrite`.
        OutputInUse: another process packs into `out`.
        OSError: the disk is full; `out` doesn't appear, because the store is read back first.
        ValueError: there is nothing to pack.

    Example:
        >>> import tempfile, nvsdata
        >>> from pathlib import Path
        >>> root = Path(tempfile.mkdtemp())
        >>> (root / "data/waving").mkdir(parents=True)
        >>> _ = nvsdata.write(nvsdata.example(), root / "data/waving/0.npy")
        >>> nvsdata.pack(nvsdata.EventFolder(root / "data"), root / "data.h5").packed
        1
        >>> len(nvsdata.EventFolder(root / "data.h5"))
        1
    """
    target = Path(out).expanduser()
    with creating(target, overwrite=overwrite), named(target):
        names = dataset.recording_names()
        with Part(target.with_name(f".{target.name}.part"), dataset, names) as part:
            done = part.done
            todo = [name for name in names if name not in done]
            what, begun = f"packing {dataset.info.name}", len(names) - len(todo)
            try:
                with bar(None, what, total=len(names), initial=begun, unit="rec") as progress:
                    decode = partial(_decode, dataset.source, dataset.opened_with)
                    for name, result in zip(todo, in_order(decode, todo, jobs), strict=True):
                        part.add(name, result)
                        progress.update()
            except BaseException:
                progress_made = f"{len(part.done):,} of {len(names):,} recordings"
                say(f"{progress_made} are in {shown(part.folder)}: the same command resumes")
                raise
        if not part.facts:
            raise ValueError(f"nothing to pack in {dataset.root}: {part.skipped}")
        try:
            with atomic(target, through_link=True) as temporary:
                _assemble(part, dataset, temporary, compress)
        except BaseException:
            say(f"all recordings are in {shown(part.folder)}: the same command resumes")
            raise
        shutil.rmtree(part.folder)
    return PackReport(len(part.facts), part.events, part.skipped)


Decoded = tuple[dict[str, Any], list[np.ndarray]] | str


def _decode(source: Source, size: tuple[int, int] | None, name: str) -> Decoded:
    """Return facts and columns of a recording, or the reason why it can't be packed."""
    try:
        stamp = source.stamp(name) if name not in source.left_out else ()
        recording = source.open(name, size)
        events = recording.read()
    except (OSError, ValueError) as error:
        return str(error)
    if not len(events):
        return "no events"
    base = int(events.t[0])
    kind = np.uint16 if max(events.sensor_size) > 256 else np.uint8
    columns = [events.t - base, events.x.astype(kind), events.y.astype(kind), events.p]
    facts = {
        "name": name,
        "events": len(events),
        "base": base,
        "size": events.sensor_size,
        "format": recording.format,
        "time": [UNSTATED, UNSTATED] if events.stated_end is None else [events.start, events.stated_end],
        "bytes": source.size(name),
        "stamp": stamp,
    }
    return facts, columns


def _assemble(part: Part, dataset: EventDataset, path: Path, compress: bool) -> None:
    """Write the store from the columns and facts in `part`, and read it back."""
    facts = part.facts
    offset = np.concatenate(([0], np.cumsum([line["events"] for line in facts])))
    bounds = list(pairwise(offset.tolist()))
    raw = part.raw()
    longest = max(int(raw["t"][end - 1]) for _, end in bounds)
    pixel = np.dtype(np.uint8 if max(max(line["size"]) for line in facts) <= 256 else np.uint16)
    kinds = part.kinds | {"t": np.dtype(np.uint32 if longest <= NARROW else np.int64), "x": pixel, "y": pixel}
    chunk = min(1 << 16, part.events)
    options = {"chunks": (chunk,), "compression": "gzip", "shuffle": True} if compress else {}
    with created(path) as (file, disk):
        for name in COLUMNS:
            column = file.create_dataset(f"events/{name}", shape=raw[name].shape, dtype=kinds[name], **options)
            for start in range(0, len(raw[name]), COPIED):
                column[start : start + COPIED] = raw[name][start : start + COPIED].astype(kinds[name])
                disk.check()
        index: dict[str, np.ndarray] = {
            "offset": offset.astype(np.int64),
            "base": np.array([line["base"] for line in facts], np.int64),
            "duration": np.array([raw["t"][end - 1] for _, end in bounds], np.int64),
            "time": np.array([line["time"] for line in facts], np.int64),
            "mark": np.concatenate([raw["t"][a:b:MARKED] for a, b in bounds]).astype(kinds["t"]),
            "size": np.array([line["size"] for line in facts], np.int32),
            "bytes": np.array([line["bytes"] for line in facts], np.int64),
            "crc": np.fromiter(_checksums(part, raw, bounds, kinds), np.uint32),
            "format": pack_texts(line["format"] for line in facts),
            "name": pack_texts(line["name"] for line in facts),
            "folder": pack_texts(dataset.listing),
            "left_out": pack_texts(part.skipped),
            "reason": pack_texts(reason.replace("\0", " ") for reason in part.skipped.values()),
            **_side_files(dataset, part),
        }
        for name in INDEX:
            file.create_dataset(f"index/{name}", data=index[name])
            disk.check()
        file.attrs.update(
            format=np.bytes_(STORE),
            version=VERSION,
            dataset=np.bytes_(dataset.info.name),
            split=np.bytes_(dataset.packed_split),
            fold=dataset.fold,
            checksum=checksum(index),
        )
    _read_back(path)


def _checksums(
    part: Part, raw: dict[str, np.ndarray], bounds: list[tuple[int, int]], kinds: dict[str, np.dtype[Any]]
) -> Iterator[int]:
    """Yield the checksum of each recording, converted to the store's types; OSError if the raw files were changed."""
    for line, (a, b) in zip(part.facts, bounds, strict=True):
        columns = {name: raw[name][a:b] for name in COLUMNS}
        if crc_of(list(columns.values())) != line["crc"]:
            raise OSError(f"{part.folder} lost events of {line['name']}: pack again")
        yield crc_of([values.astype(kinds[name], copy=False) for name, values in columns.items()])


def _read_back(path: Path) -> None:
    """Raise OSError unless the file is a store whose index and events match their checksums."""
    store = Store(path)
    for name in store.names:
        if store.fault(name):
            raise OSError(f"{path}: the events of {name} can't be read back as they were written")


def _side_files(dataset: EventDataset, part: Part) -> dict[str, np.ndarray]:
    """Return the index arrays of side files: all small files that aren't recordings, such as lists and labels."""
    names, blobs = [], []
    recordings = part.done.union(dataset.files_of(dataset.found()))
    for folder, files in dataset.listing.items():
        for file in files:
            name = path_below(folder, file)
            # a store isn't a side file, even if it is being replaced
            known = name in recordings or name.lower().endswith((".h5", ".hdf5"))
            if not known and dataset.source.size(name) <= MOST_SIDE_BYTES:
                names.append(name)
                blobs.append(dataset.source.data(name))
    return {
        "file_name": pack_texts(names),
        "file_offset": np.concatenate(([0], np.cumsum([len(blob) for blob in blobs]))).astype(np.int64),
        "file_data": np.frombuffer(b"".join(blobs), np.uint8),
    }
