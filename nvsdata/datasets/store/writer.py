"""Packing of the recordings of a dataset into a store."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.data.events import EVER, Columns
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.source import Source, path_below
from nvsdata.datasets.store.part import JournalLine
from nvsdata.datasets.store.record import events_of, head_of, record_of
from nvsdata.datasets.store.writing import Made, StoreWriter
from nvsdata.kernels.decode.blocks import blocks_between

MOST_SIDE_BYTES = 1 << 24  # files that aren't recordings are left out if they are larger
STORES = (".nvs", ".h5", ".hdf5")  # extensions of stores, which aren't side files


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
    scheduler: str | None = None,
    compress: bool = False,
    overwrite: bool = False,
    shard: tuple[int, int] | None = None,
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
        scheduler: address of a Dask cluster that decodes in place of local processes (`nvsdata[distributed]`). Its
            workers must have the dataset under the same path; this process alone writes.
        compress: whether to compress the events.
        overwrite: whether to replace an existing file.
        shard: (i, n), with i from 1 to n: pack every n-th recording from the i-th on, into `shard_path(out, shard)`,
            such as out-2-of-8.nvs. `join` makes a store of all shards, which different machines may have packed.

    Returns:
        The number of recordings and events, and the recordings that were left out.

    Raises:
        FileExistsError: `out` exists, unless `overwrite`.
        OutputInUse: another process packs into `out`.
        OSError: the disk is full; `out` doesn't appear, because the store is read back first.
        TypeError: the dataset has precomputed samples, no recordings.
        ValueError: there is nothing to pack, or `shard` isn't (i, n).

    Example:
        >>> import tempfile, nvsdata
        >>> from pathlib import Path
        >>> root = Path(tempfile.mkdtemp())
        >>> (root / "data/waving").mkdir(parents=True)
        >>> _ = nvsdata.write(nvsdata.example(), root / "data/waving/0.npy")
        >>> nvsdata.pack(nvsdata.EventFolder(root / "data"), root / "data.nvs").packed
        1
        >>> len(nvsdata.EventFolder(root / "data.nvs"))
        1
    """
    if not isinstance(dataset, EventDataset):
        raise TypeError("recordings are packed, not precomputed samples: `push` and `join` take their file as it is")
    names = dataset.recording_names()
    skipped = _left_out(dataset)
    side_files = partial(_side_files, dataset, {*names, *skipped})
    writer = StoreWriter(
        dataset,
        items={name: name for name in names},
        files=str,
        make=partial(_decode, dataset.source, dataset.opened_with, compress),
        intact=_is_intact,
        run={"compress": compress},
        what=f"packing {dataset.info.name}",
        skipped=skipped,
        # the first shard has what isn't a recording
        sections=lambda _: side_files() if shard is None or shard[0] == 1 else {},
    )
    part = writer.write(Path(out).expanduser(), jobs=jobs, scheduler=scheduler, overwrite=overwrite, shard=shard)
    return PackReport(len(part.facts), sum(facts.events for facts in part.facts), part.skipped)


def _decode(source: Source, size: tuple[int, int] | None, compress: bool, name: str) -> Made:
    """Return facts and record of a recording, or the reason why it can't be packed."""
    try:
        stamp = source.stamp(name) if name not in source.left_out else ()
        recording = source.open(name, size)
        events = recording.read()
    except (OSError, ValueError) as error:
        return str(error)
    if not len(events):
        return "no events"
    time = (None, None) if events.stated_end is None else (events.start, events.stated_end)
    columns = Columns(events.t, events.x, events.y, events.p)
    how = {"compress": compress, "guessed": recording.size_is_guessed}
    record = record_of(columns, events.sensor_size, time, recording.format, **how)
    check = int.from_bytes(record[:4], "little")
    return JournalLine(name, len(events), len(record), check, source.size(name), list(stamp)), record


def _left_out(dataset: EventDataset) -> dict[str, str]:
    """Return the recordings that the dataset itself leaves out, name to reason."""
    reasons = dataset.source.left_out
    return {name: reasons.get(name, "empty") for name in dataset.skipped}


def _is_intact(raw: np.ndarray, facts: JournalLine) -> bool:
    """Return whether the bytes of a record are those of its line."""
    try:
        head = head_of(raw, facts.length)
        first, last, begin, end, most = blocks_between(head.table, head.span[0], *EVER)
        t = events_of(head, first, last, raw[head.bytes :][begin:end], *EVER, most).t
    except ValueError:  # also a FormatError, or a BlockError
        return False
    return head.check == facts.check and t.size == facts.events and (int(t[0]), int(t[-1])) == head.span


def _side_files(dataset: EventDataset, packed: set[str]) -> dict[str, Any]:
    """Return the index's sections of side files: small files that aren't recordings, such as lists and labels."""
    names, blobs = [], []
    recordings = packed.union(dataset.files_of(dataset.found()))
    for folder, files in dataset.listing.items():
        for file in files:
            name = path_below(folder, file)
            # a store isn't a side file, even if it is being replaced
            known = name in recordings or name.lower().endswith(STORES)
            if not known and dataset.source.size(name) <= MOST_SIDE_BYTES:
                names.append(name)
                blobs.append(dataset.source.data(name))
    return {"file_name": names, "file_end": list(accumulate(map(len, blobs))), "file_data": b"".join(blobs)}
