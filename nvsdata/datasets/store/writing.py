"""Writing of a store's records: in parallel, resumable, and completely or not at all."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.batch.scheduler import in_order, in_shard
from nvsdata.common.errors import shown
from nvsdata.common.files import creating, named, write_all
from nvsdata.common.progress import bar
from nvsdata.common.terminal import say
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.store.index import BEGIN, file_head, pack_texts, packed_index
from nvsdata.datasets.store.part import JournalLine, Part
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.shards import shard_path

Made = tuple[JournalLine, bytes] | str
"""Line and bytes of a record, or the reason why there is none."""


@dataclass(frozen=True)
class StoreWriter:
    """Writer of a store, or of a shard of it.

    Args:
        dataset: the dataset whose recordings are read.
        items: what each record is made of, by the record's name.
        files: file below the root of which each record is made, by the record's name.
        make: function that makes a record of an item; processes and clusters call it.
        intact: function that returns whether the bytes of a record are those of its line.
        what: name of the activity.
        run: settings on which records depend.
        shared: further such settings, which all shards of a store must share.
        facts: facts that the index states, in addition to the dataset.
        skipped: names that are left out, name to reason.
        sections: function that returns further sections of the index for the names that have a record.
    """

    dataset: EventDataset
    items: Mapping[str, Any]
    files: Callable[[str], str]
    make: Callable[[Any], Made]
    intact: Callable[[np.ndarray, JournalLine], bool]
    what: str
    run: dict[str, Any] = field(default_factory=dict)
    shared: Sequence[str] = ()
    facts: dict[str, Any] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)
    sections: Callable[[Sequence[str]], dict[str, Any]] = lambda names: {}

    def write(
        self, out: Path, *, jobs: int, scheduler: str | None, overwrite: bool, shard: tuple[int, int] | None
    ) -> Part:
        """Write the store `out`, or a shard of it, and return its records and what was left out; see `pack`."""
        every = list(self.items)
        mine = in_shard(every, shard)
        target = given = shard_path(out, shard)
        with ExitStack() as locks:
            locks.enter_context(creating(given, overwrite=overwrite))
            locks.enter_context(named(given))
            if given.is_symlink():
                # the link stays, and its target is replaced
                target = Path(os.path.realpath(given))
                locks.enter_context(creating(target, overwrite=True))
            with self._begun(target, mine, shard) as part:
                self._add_missing(part, mine, jobs, scheduler)
            # a shard without records belongs to its store, too
            if not part.facts and shard is None:
                raise ValueError(f"nothing to write from {self.dataset.root}: {part.skipped}")
            facts = {
                "dataset": self.dataset.info.name,
                "split": self.dataset.packed_split,
                "fold": self.dataset.fold,
                **self.facts,
            }
            if shard is not None:
                of_all = pack_texts([*every, str(list(self.dataset.opened_with or ())), *self.shared])
                facts["shard"] = [*shard, hashlib.sha256(of_all).hexdigest()]
            try:
                sections = self.sections([line.name for line in part.facts])
                _finish(part, facts, {"folder": self.dataset.listing, **sections}, target)
            except BaseException:
                say(f"all records are in {shown(part.folder)}: the same command resumes")
                raise
            shutil.rmtree(part.folder)
        return part

    def _begun(self, target: Path, names: Sequence[str], shard: tuple[int, int] | None) -> Part:
        """Return the unfinished store, with the records of an earlier run."""
        run = {
            "dataset": self.dataset.info.name,
            "root": str(root.resolve() if isinstance(root := self.dataset.root, Path) else root),
            "opened_with": list(self.dataset.opened_with or ()),
            **self.run,
            **({"shared": list(self.shared)} if self.shared else {}),
        }
        # the first shard reports what was left out before
        skipped = self.skipped if shard is None or shard[0] == 1 else {}
        stamp = self.dataset.source.stamp
        return Part(
            target.with_name(f".{target.name}.part"),
            run,
            names,
            skipped,
            lambda name: stamp(self.files(name)),
            self.intact,
        )

    def _add_missing(self, part: Part, names: Sequence[str], jobs: int, scheduler: str | None) -> None:
        done = part.done
        todo = [name for name in names if name not in done]
        items = [self.items[name] for name in todo]
        try:
            with (
                bar(None, self.what, total=len(names), initial=len(names) - len(todo), unit="rec") as progress,
                closing(in_order(self.make, items, jobs, scheduler)) as results,
            ):
                for name, result in zip(todo, results, strict=True):
                    part.add(name, result)
                    progress.update()
        except BaseException:
            say(f"{len(part.done):,} of {len(names):,} records are in {shown(part.folder)}: the same command resumes")
            raise


def _finish(part: Part, stated: dict[str, Any], sections: dict[str, Any], target: Path) -> None:
    """Add head and index to the records, read the store back, and let it appear as `target`.

    The index states the facts `stated`, and has `sections` that don't depend on the records.
    """
    index = packed_index(
        stated,
        place=list(accumulate((facts.length for facts in part.facts), initial=BEGIN)),
        bytes=[facts.bytes for facts in part.facts],
        check=[facts.check for facts in part.facts],
        name=[facts.name for facts in part.facts],
        left_out=part.skipped,
        reason=[reason.replace("\0", " ") for reason in part.skipped.values()],
        **sections,
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
    """Raise OSError unless the file is a store whose index and records match their checksums."""
    with closing(Store(path)) as store:
        for name in store.names:
            if store.fault(name):
                raise OSError(f"{target}: the record of {name} can't be read back as it was written")
