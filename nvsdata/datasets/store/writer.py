"""Packing of a dataset into a store: in parallel, resumable, and completely or not at all."""

from __future__ import annotations

import os
import shutil
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any

from nvsdata.batch.scheduler import in_order
from nvsdata.common.errors import shown
from nvsdata.common.files import creating, named, write_all
from nvsdata.common.progress import bar
from nvsdata.common.terminal import say
from nvsdata.data.events import Columns
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.source import Source, path_below
from nvsdata.datasets.store.index import BEGIN, file_head, packed_index
from nvsdata.datasets.store.part import JournalLine, Part
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.record import record_of

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
        compress: whether to compress the events.
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
        >>> nvsdata.pack(nvsdata.EventFolder(root / "data"), root / "data.nvs").packed
        1
        >>> len(nvsdata.EventFolder(root / "data.nvs"))
        1
    """
    target = given = Path(out).expanduser()
    with ExitStack() as locks:
        locks.enter_context(creating(given, overwrite=overwrite))
        locks.enter_context(named(given))
        if given.is_symlink():
            # the link stays, and its target is replaced
            target = Path(os.path.realpath(given))
            locks.enter_context(creating(target, overwrite=True))
        names = dataset.recording_names()
        with Part(target.with_name(f".{target.name}.part"), dataset, names, compress=compress) as part:
            done = part.done
            todo = [name for name in names if name not in done]
            what, begun = f"packing {dataset.info.name}", len(names) - len(todo)
            try:
                with bar(None, what, total=len(names), initial=begun, unit="rec") as progress:
                    decode = partial(_decode, dataset.source, dataset.opened_with, compress)
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
            _finish(part, dataset, target)
        except BaseException:
            say(f"all recordings are in {shown(part.folder)}: the same command resumes")
            raise
        shutil.rmtree(part.folder)
    return PackReport(len(part.facts), sum(facts.events for facts in part.facts), part.skipped)


def _decode(source: Source, size: tuple[int, int] | None, compress: bool, name: str) -> tuple[JournalLine, bytes] | str:
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
    record = record_of(columns, events.sensor_size, time, recording.format, compress=compress)
    check = int.from_bytes(record[:4], "little")
    return JournalLine(name, len(events), len(record), check, source.size(name), list(stamp)), record


def _finish(part: Part, dataset: EventDataset, target: Path) -> None:
    """Add head and index to the records, read the store back, and let it appear as `target`."""
    place = list(accumulate((facts.length for facts in part.facts), initial=BEGIN))
    facts = {"dataset": dataset.info.name, "split": dataset.packed_split, "fold": dataset.fold}
    index = packed_index(
        facts,
        place=place,
        bytes=[facts.bytes for facts in part.facts],
        check=[facts.check for facts in part.facts],
        name=[facts.name for facts in part.facts],
        folder=dataset.listing,
        left_out=part.skipped,
        reason=[reason.replace("\0", " ") for reason in part.skipped.values()],
        **_side_files(dataset, part),
    )
    with part.data.open("r+b", buffering=0) as file:
        file.seek(part.end)
        write_all(file.fileno(), index)
        file.seek(0)
        write_all(file.fileno(), file_head(part.end, index))
        os.fsync(file.fileno())
    _read_back(part.data, target)
    if target.exists():
        shutil.copymode(target, part.data)
    os.replace(part.data, target)


def _read_back(path: Path, target: Path) -> None:
    """Raise OSError unless the file is a store whose index and events match their checksums."""
    with closing(Store(path)) as store:
        for name in store.names:
            if store.fault(name):
                raise OSError(f"{target}: the events of {name} can't be read back as they were written")


def _side_files(dataset: EventDataset, part: Part) -> dict[str, Any]:
    """Return the index's sections of side files: small files that aren't recordings, such as lists and labels."""
    names, blobs = [], []
    recordings = part.done.union(dataset.files_of(dataset.found()))
    for folder, files in dataset.listing.items():
        for file in files:
            name = path_below(folder, file)
            # a store isn't a side file, even if it is being replaced
            known = name in recordings or name.lower().endswith(STORES)
            if not known and dataset.source.size(name) <= MOST_SIDE_BYTES:
                names.append(name)
                blobs.append(dataset.source.data(name))
    return {"file_name": names, "file_end": list(accumulate(map(len, blobs))), "file_data": b"".join(blobs)}
