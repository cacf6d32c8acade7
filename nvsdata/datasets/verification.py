"""Verification of recordings: each is read, and the files are compared with the expected ones."""

from __future__ import annotations

import os
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from nvsdata.batch.manifest import NAME, recording_fault
from nvsdata.batch.scheduler import in_order, in_shard
from nvsdata.common.errors import line_of
from nvsdata.common.files import Journal
from nvsdata.common.progress import bar
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.facts import ExpectedCount
from nvsdata.datasets.registry import DATASETS
from nvsdata.datasets.source import Folder, Source, recordings_in
from nvsdata.datasets.store.opening import open_store
from nvsdata.datasets.store.reader import Store
from nvsdata.formats.text_layout import looks_like
from nvsdata.remote.url import Url

SHOWN = 3  # names in a message
Item = TypeVar("Item")
KINDS = {"nvsdata-videos", "nvsdata-recordings"}  # first keys of the manifests of `convert-videos` and `record`


@dataclass(frozen=True)
class _Readers:
    """Who reads the recordings, and which of them; see `problems`."""

    jobs: int
    scheduler: str | None
    shard: tuple[int, int] | None

    @property
    def first(self) -> bool:
        """True if faults of the whole are reported, which one shard does."""
        return self.shard is None or self.shard[0] == 1

    def each(self, check: Callable[[Item], Any], items: Sequence[Item], what: str) -> Iterator[tuple[Item, Any]]:
        """Yield the items of the shard with the results of `check`, in order, and show the progress."""
        mine = in_shard(items, self.shard)
        with closing(in_order(check, mine, self.jobs, self.scheduler)) as results:
            yield from zip(mine, bar(results, what, total=len(mine), unit="rec"), strict=True)


def problems(
    root: Path | Url,
    dataset: type[EventDataset] | None = None,
    counts: Counter[str] | None = None,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    shard: tuple[int, int] | None = None,
) -> Iterator[tuple[str, str]]:
    """Yield name and fault of every damaged or missing recording below `root`, or in a packed store.

    A recording has a fault if it is unreadable, empty, truncated or out of order in time, has events outside the
    sensor, or was left out of the store. Recordings that `convert-videos` or `record --monitor` made are compared with
    their manifests, by size and sha256. Videos that failed or weren't reached, and recordings that are in no manifest,
    are faults, too.

    For a known dataset, the recordings are compared with the expected ones: their number in each class and part, their
    names if known, and the lists of splits next to them.

    Args:
        root: a folder, or path or URL of a packed store.
        dataset: class of the dataset, which finds the recordings and knows their sensor (default: the class that a
            store names; for a folder, recordings of any dataset are read).
        counts: gets the numbers of recordings that were "opened", "compared" with a manifest, and "guessed": their
            sensor size isn't stated, so that events outside the sensor aren't found.
        jobs: number of processes that read.
        scheduler: address of a Dask cluster that reads in place of local processes; it must have the same paths.
        shard: (i, n), with i from 1 to n: read every n-th recording from the i-th on. Missing recordings and other
            faults of the whole are reported by the first shard.

    Raises:
        FileNotFoundError: `root` doesn't exist, or has no recordings.
        FormatError: `root` is a file, but not a store.
    """
    counts = Counter() if counts is None else counts
    readers = _Readers(jobs, scheduler, shard)
    given = root.address if isinstance(root, Url) else root
    if isinstance(root, Path):
        if not root.exists():
            raise FileNotFoundError(f"{root}: no such folder or store")
        yield from _by_manifests(root, counts, readers)
    if dataset is not None:
        found = dataset.complete(given)
    elif isinstance(root, Path) and not root.is_file():
        yield from _of_files(Folder(root), root, counts, readers)
        return
    elif _is_dataset(store := open_store(root)):
        kind = DATASETS[store.dataset]
        found = kind.complete(given) if store.split == "all" else kind(given, store.split, fold=store.fold or None)
    else:
        yield from _of_files(store, Path(store.path), counts, readers)
        return
    left_out = found.source.left_out
    if readers.first:
        yield from ((name, "empty") for name in found.skipped if name not in left_out)
    names = [name for name in found.recording_names() if name not in left_out]
    yield from _each(found.source, names, found.opened_with, counts, readers)
    if found.split_name == "all" and readers.first:
        yield from _missing_in(found)


def _is_dataset(store: Store) -> bool:
    """Return whether a store has the recordings of a known dataset."""
    return store.dataset in DATASETS and store.shard is None and store.precomputed is None


def split_hashes(root: Path | Url, dataset: type[EventDataset] | None = None) -> dict[str, str]:
    """Return the hash of each split that `root` has, by name; empty for an unknown dataset."""
    kind, found = dataset, dict[str, str]()
    if kind is None and (isinstance(root, Url) or root.is_file()) and (name := open_store(root).dataset) in DATASETS:
        kind = DATASETS[name]
    if kind is None:
        return found
    for split in kind.splits:
        with suppress(OSError, ValueError):
            found[split] = kind(root.address if isinstance(root, Url) else root, split).split_hash
    return found


def _by_manifests(root: Path, counts: Counter[str], readers: _Readers) -> Iterator[tuple[str, str]]:
    """Yield the differences between recordings and the manifests of their folders."""
    # the manifest of a shard is newer than that of the folder
    paths = sorted(root.rglob("manifest*.jsonl"), key=lambda path: (path.name != NAME, path)) if root.is_dir() else ()
    by_folder: dict[Path, list[Journal]] = {}
    for path in paths:
        try:
            journal = Journal(path, {})
        except OSError as error:
            yield path.relative_to(root).as_posix(), f"can't be read: {error.strerror or error}"
            continue
        if not KINDS.isdisjoint(journal.head):
            by_folder.setdefault(path.parent, []).append(journal)
    known = set[Path]()
    for folder, journals in by_folder.items():
        try:
            yield from _by_manifest(root, folder, journals, known, counts, readers)
        except (TypeError, ValueError, AttributeError, KeyError, OSError) as error:
            yield journals[0].path.relative_to(root).as_posix(), f"isn't a manifest, or damaged: {line_of(error)}"
    for name in _recordings(Folder(root), root) if by_folder and readers.first else ():
        # `known` has the recordings of all manifests, including those of subfolders
        if root / name not in known and not by_folder.keys().isdisjoint((root / name).parents):
            yield name, "is in no manifest of its folder"


def _by_manifest(
    root: Path, folder: Path, journals: list[Journal], known: set[Path], counts: Counter[str], readers: _Readers
) -> Iterator[tuple[str, str]]:
    """Yield the differences between a folder and its manifests; add its recordings to `known`."""
    lines = {str(line["video"]): line for journal in journals for line in journal.lines}
    faults = [
        (name, "has no recording: the run ended before it was reached")
        for name in {str(name): None for journal in journals for name in journal.head.get("videos", [])}
        if name not in lines
    ]
    stated = []
    for name, line in lines.items():
        if "reason" in line:
            faults.append((name, f"{line.get('status')}: {line['reason']}"))
        if "file" not in line or "recording" not in line:
            continue
        path = Path(os.path.abspath(folder / line["file"]))
        if not path.is_relative_to(os.path.abspath(folder)):
            faults.append((name, f"its manifest names a recording outside the folder: {line['file']!r}"))
            continue
        known.add(folder / line["file"])
        stated.append((path, line))
    yield from faults if readers.first else ()
    for (_, line), fault in readers.each(_compared, stated, "comparing"):
        counts["compared"] += 1
        if fault:
            yield (folder / line["file"]).relative_to(root).as_posix(), fault


def _compared(stated: tuple[Path, dict[str, Any]]) -> str:
    """Describe how a recording differs from its line of the manifest; empty if it doesn't."""
    return recording_fault(*stated, check=True)


def _recordings(source: Source, root: Path) -> list[str]:
    """Return the recordings of a folder, without text files that are lists of splits or labels."""
    texts = (".txt", ".csv")
    found = recordings_in(source.listing())
    return [name for name in found if not (name.lower().endswith(texts) and _is_list(root / name))]


def _of_files(source: Source, root: Path, counts: Counter[str], readers: _Readers) -> Iterator[tuple[str, str]]:
    """Yield the faults of all recordings of a source."""
    names = source.names if isinstance(source, Store) else _recordings(source, root)
    if not names:
        raise FileNotFoundError(f"no recordings below {root}")
    yield from _each(source, names, None, counts, readers)


def _each(
    source: Source, names: Sequence[str], size: tuple[int, int] | None, counts: Counter[str], readers: _Readers
) -> Iterator[tuple[str, str]]:
    """Yield what a store left out, and the faults of recordings and of lost shards."""
    if readers.first:
        yield from ((name, f"left out when it was packed: {reason}") for name, reason in source.left_out.items())
    for shard, (reason, lost) in (source.lost() if isinstance(source, Store) else {}).items():
        if readers.first:
            yield shard, f"{reason} ({len(lost):,} recordings)"
        names = [name for name in names if name not in lost]
    for name, (faults, guessed) in readers.each(partial(_faults, source, size), names, "verifying"):
        counts["opened"] += 1
        if guessed:
            counts["guessed"] += 1
        yield from ((name, fault) for fault in faults)


def _is_list(path: Path) -> bool:
    """Return whether a text file contains something other than events, such as a list of splits or labels."""
    with path.open("rb") as file:
        return not looks_like(file.read(4096), 0)


def _faults(source: Source, size: tuple[int, int] | None, name: str) -> tuple[list[str], bool]:
    """Return the faults of a recording, and whether its sensor size is guessed."""
    if isinstance(source, Store) and (fault := source.fault(name)):
        return [fault], False
    if isinstance(source, Store) and source.precomputed is not None:
        return [], False
    try:
        recording = source.open(name, size, strict=False)
        events = recording.read()
    except (OSError, ValueError) as error:
        return [str(error)], False
    repairs = [f"{count} {what}" for what, count in recording.repairs.items()]
    return repairs if len(events) else [*repairs, "empty"], recording.size_is_guessed


def _missing_in(dataset: EventDataset) -> Iterator[tuple[str, str]]:
    """Yield missing and unexpected recordings of a dataset."""
    there, expected, what = dataset.total()
    if expected and there != expected:
        yield dataset.info.name, f"{there:,} {what}, {expected:,} expected ({dataset.info.known_from})"
    found = dataset.found()
    expected_counts = dataset.info.expected_counts
    if expected_counts:
        in_parts = any(one.part for one in expected_counts)
        names = (
            Found(_part(dataset, sample.name) if in_parts else "", dataset.classes[sample.label], sample.stem)
            for sample in found
        )
        yield from missing_recordings(expected_counts, names)
    stems = {os.path.splitext(os.path.basename(name))[0].lower() for name in dataset.files_of(found)}
    for name, listed in dataset.split_lists().items():
        if missing := [stem for stem in listed if stem.lower() not in stems]:
            yield (
                name,
                f"{len(missing):,} of {len(listed):,} recordings that it lists are missing: {some_names(missing)}",
            )


def _part(dataset: EventDataset, name: str) -> str:
    return dataset.part_of(os.path.dirname(name)) or ""


class Found(NamedTuple):
    """A recording that was found: part of the dataset ("" if it has no parts), class, and name without extension."""

    part: str
    label: str
    stem: str


def missing_recordings(expected_counts: Sequence[ExpectedCount], found: Iterable[Found]) -> Iterator[tuple[str, str]]:
    """Yield (part and class, fault) for each part and class with missing or unexpected recordings.

    The message lists the recordings if their names are known.
    """
    there: dict[tuple[str, str], set[str]] = defaultdict(set)
    for part, label, stem in found:
        there[part, label].add(stem)
        there[part, ""].add(stem)
    wanted: dict[tuple[str, str], list[ExpectedCount]] = defaultdict(list)
    for one in expected_counts:
        wanted[one.part, one.label].append(one)
    for (part, label), counts in wanted.items():
        stems = there[part, label]
        expected = {stem for one in counts for stem in one.stems}
        count = sum(one.count for one in counts)
        where = "/".join(name for name in (part, label) if name)
        if expected and (missing := sorted(expected - stems)):
            yield where, f"{len(missing):,} of {count:,} recordings are missing: {some_names(missing)}"
        elif not expected and len(stems) < count:
            yield where, f"{count - len(stems):,} of {count:,} recordings are missing"
        if expected and (strange := sorted(stems - expected)):
            yield where, f"{len(strange):,} recordings that the dataset doesn't have: {some_names(strange)}"
        elif not expected and len(stems) > count:
            yield where, f"{len(stems):,} recordings, though the dataset has {count:,}"


def some_names(names: Sequence[str]) -> str:
    """Return the first `SHOWN` names, and the number of the others."""
    more = len(names) - SHOWN
    return ", ".join(names[:SHOWN]) + (f" and {more:,} more" if more > 0 else "")
