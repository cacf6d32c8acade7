"""Packing a dataset into a store: in parallel, resumable, and whole or not at all."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from tqdm import tqdm

from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.source import Source, joined
from nvsdata.datasets.store import COLUMNS, INDEX, MARKED, VERSION, checksum, crc_of
from nvsdata.files import atomic
from nvsdata.formats.hdf5 import STORE
from nvsdata.formats.hdf5_writer import WRITING
from nvsdata.processes import pool

JOURNAL = "journal.jsonl"
COPIED = 1 << 24  # events that are copied at once
MOST_SIDE_BYTES = 1 << 24  # of a file that is no recording: larger ones aren't taken along
AHEAD = 8  # recordings a process works ahead of the writer
NARROW = np.iinfo(np.uint32).max


@dataclass
class Report:
    """What was packed, and what was left out and why (name to reason)."""

    packed: int = 0
    events: int = 0
    skipped: dict[str, str] = field(default_factory=dict)


def pack(dataset: EventDataset, out: str | os.PathLike[str], *, jobs: int = 1, compress: bool = False) -> Report:
    """Write the recordings of `dataset` and its small side files (lists, labels) into the store `out`.

    The dataset's class opens the store in place of a folder, with the same samples: pack
    `split="all"` and every split and fold can be had of it. Recordings without events or with a
    FormatError are left out and reported. Until the store is whole, the work lies in `out` + ".part",
    from which a run that was stopped goes on.
    """
    target = Path(out)
    names = dataset.recording_names()
    part = _Part(target.with_name(target.name + ".part"), dataset, names)
    done = part.done
    todo = [name for name in names if name not in done]
    bar = tqdm(
        total=len(names), initial=len(names) - len(todo), unit="rec", desc=f"packing {dataset.info.name}", disable=None
    )
    with part, bar:
        for name, result in _decoded(dataset, todo, jobs):
            part.add(name, result)
            bar.update()
    report = part.report
    if not report.packed:
        raise ValueError(f"nothing to pack in {dataset.root}: {report.skipped}")
    with atomic(target) as temporary:
        _assemble(part, dataset, temporary, compress)
    shutil.rmtree(part.folder)
    return report


Decoded = tuple[dict[str, Any], list[np.ndarray]] | str


def _decode(source: Source, name: str, size: tuple[int, int] | None) -> Decoded:
    """Facts and columns of a recording, or why it can't be packed."""
    try:
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
        "bytes": source.size(name),
    }
    return facts, columns


def _decoded(dataset: EventDataset, names: list[str], jobs: int) -> Iterator[tuple[str, Decoded]]:
    """Every recording decoded, in order; by `jobs` processes that work a little ahead."""
    size = dataset.opened_with
    if jobs == 1:
        for name in names:
            yield name, _decode(dataset.source, name, size)
        return
    with pool(jobs, __name__) as workers:
        waiting: list[tuple[str, Any]] = []
        for name in names:
            waiting.append((name, workers.submit(_decode, dataset.source, name, size)))
            if len(waiting) >= AHEAD * jobs:
                first, future = waiting.pop(0)
                yield first, future.result()
        for name, future in waiting:
            yield name, future.result()


class _Part:
    """The unfinished store: a raw file a column, and a journal with a line a recording."""

    def __init__(self, folder: Path, dataset: EventDataset, names: list[str]) -> None:
        self.folder = folder
        self.report = Report(skipped=dict.fromkeys(dataset.skipped, "empty"))
        self.facts: list[dict[str, Any]] = []
        size = dataset.sensor_size
        kind = np.dtype(np.uint8 if size is not None and max(size) <= 256 else np.uint16)
        self.kinds = {"t": np.dtype(np.int64), "x": kind, "y": kind, "p": np.dtype(np.uint8)}
        folder.mkdir(parents=True, exist_ok=True)
        self._read_journal(set(names))

    @property
    def done(self) -> set[str]:
        """Recordings that are packed or left out."""
        return {facts["name"] for facts in self.facts} | set(self.report.skipped)

    def _read_journal(self, names: set[str]) -> None:
        journal = self.folder / JOURNAL
        lines = journal.read_bytes().splitlines(keepends=True) if journal.exists() else []
        whole = 0
        for line in lines:
            # the last line may be torn; a recording that has gone makes all after it worthless
            facts = json.loads(line) if line.endswith(b"\n") else {}
            if facts.get("name") not in names:
                break
            whole += len(line)
            # what was left out is tried again: it may have been mended meanwhile
            if "skipped" not in facts:
                self._note(facts)
        if journal.exists():
            os.truncate(journal, whole)
        events = self.report.events
        for name, kind in self.kinds.items():
            path = self.folder / name
            path.touch()
            os.truncate(path, events * kind.itemsize)

    def _note(self, line: dict[str, Any]) -> None:
        if "skipped" in line:
            self.report.skipped[line["name"]] = line["skipped"]
            return
        self.facts.append(line)
        self.report.packed += 1
        self.report.events += line["events"]

    def __enter__(self) -> None:
        self._columns = {name: (self.folder / name).open("ab") for name in COLUMNS}
        self._journal = (self.folder / JOURNAL).open("a")

    def __exit__(self, *_: object) -> None:
        for file in (*self._columns.values(), self._journal):
            file.close()

    def add(self, name: str, result: Decoded) -> None:
        """Append a recording: its columns first, then the line that makes them count."""
        line: dict[str, Any]
        if isinstance(result, str):
            line = {"name": name, "skipped": result}
        else:
            line, columns = result
            for column, values in zip(COLUMNS, columns, strict=True):
                self._columns[column].write(values.astype(self.kinds[column], copy=False).tobytes())
                self._columns[column].flush()
        self._journal.write(json.dumps(line) + "\n")
        self._journal.flush()
        self._note(line)


def _assemble(part: _Part, dataset: EventDataset, path: Path, compress: bool) -> None:
    """The store from its parts."""
    facts = part.facts
    offset = np.concatenate(([0], np.cumsum([line["events"] for line in facts])))
    raw = {name: np.memmap(part.folder / name, kind, "r") for name, kind in part.kinds.items()}
    longest = max(int(raw["t"][end - 1]) for end in offset[1:])
    kinds = part.kinds | {"t": np.dtype(np.uint32 if longest <= NARROW else np.int64)}
    chunk = min(1 << 16, part.report.events)
    options = {"chunks": (chunk,), "compression": "gzip", "shuffle": True} if compress else {}
    with h5py.File(path, "w", **WRITING) as file:
        for name in COLUMNS:
            column = file.create_dataset(f"events/{name}", shape=raw[name].shape, dtype=kinds[name], **options)
            for start in range(0, len(raw[name]), COPIED):
                column[start : start + COPIED] = raw[name][start : start + COPIED].astype(kinds[name])
        bounds = list(pairwise(offset.tolist()))
        crcs = [crc_of([raw[name][a:b].astype(kinds[name]) for name in COLUMNS]) for a, b in bounds]
        index: dict[str, np.ndarray] = {
            "offset": offset.astype(np.int64),
            "base": np.array([line["base"] for line in facts], np.int64),
            "duration": np.array([raw["t"][end - 1] for end in offset[1:]], np.int64),
            "mark": np.concatenate([raw["t"][a:b:MARKED] for a, b in bounds]).astype(kinds["t"]),
            "size": np.array([line["size"] for line in facts], np.int32),
            "bytes": np.array([line["bytes"] for line in facts], np.int64),
            "crc": np.array(crcs, np.uint32),
            "format": _packed_lines([line["format"] for line in facts]),
            "name": _packed_lines([line["name"] for line in facts]),
            **_side_files(dataset, part),
        }
        for name in INDEX:
            file.create_dataset(f"index/{name}", data=index[name])
        file.attrs.update(
            format=np.bytes_(STORE), version=VERSION, dataset=np.bytes_(dataset.info.name), checksum=checksum(index)
        )


def _side_files(dataset: EventDataset, part: _Part) -> dict[str, np.ndarray]:
    """Lists, labels and annotations: everything small that is no recording."""
    names, blobs = [], []
    recordings = part.done
    for folder, files in dataset.listing.items():
        for file in files:
            name = joined(folder, file)
            if name not in recordings and dataset.source.size(name) <= MOST_SIDE_BYTES:
                names.append(name)
                blobs.append(dataset.source.data(name))
    return {
        "file_name": _packed_lines(names),
        "file_offset": np.concatenate(([0], np.cumsum([len(blob) for blob in blobs]))).astype(np.int64),
        "file_data": np.frombuffer(b"".join(blobs), np.uint8),
    }


def _packed_lines(lines: list[str]) -> np.ndarray:
    return np.frombuffer("".join(line + "\n" for line in lines).encode(), np.uint8)
