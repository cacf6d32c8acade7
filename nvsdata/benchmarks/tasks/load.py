"""Benchmarks of loading samples."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle, product
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata import formats
from nvsdata import transforms as T
from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.inputs import DIGITS, digits
from nvsdata.benchmarks.measurement import OURS
from nvsdata.data.batching import collate
from nvsdata.data.events import Events
from nvsdata.datasets import ASLDVS, NMNIST
from nvsdata.datasets.cache.cached import cache
from nvsdata.datasets.source import INDEX
from nvsdata.datasets.store.writer import pack

BATCH, BINS = 50, 10
FIRST = 40  # events of each recording in the growing stores
KIND = "largest difference in the sum of all frames"


def cases(options: Options) -> list[Case]:
    """Return the cases: frames, compared with tonic; numbers of workers; random windows of files and stores."""
    return [*_frames(options), *_workers(options), *_stores(options)]


def _frames(options: Options) -> Iterator[Case]:
    for (kept, makers), workers in product({"": _MADE, " from a cache": _KEPT}.items(), (0, 2)):
        for library, make in makers.items():
            yield Case(
                *("load", f"frames of all recordings{kept}, {workers} workers"),
                partial(_epoch, options, workers, make, library),
                library,
                settings={"workers": workers},
                size={"recordings": _count(options)},
                default=library == OURS,
                error_kind=KIND,
                package=library.split(",")[0],
            )


def _workers(options: Options) -> Iterator[Case]:
    for workers in (0, 1, 2, 4):
        yield Case(
            *("load", "graphs of all recordings, persistent workers", partial(_graphs, options, workers)),
            settings={"workers": workers},
            size={"recordings": _count(options)},
            axis="workers",
        )


def _stores(options: Options) -> Iterator[Case]:
    top = 4 if options.quick else 6
    for count in (10**power for power in range(2, top + 1)):
        make = partial(_windows_of_store, options, count)
        yield Case(
            *("load", "a 30 ms window of a recording in a store", make),
            size={"recordings": count},
            axis="recordings",
            alone=True,
        )
    yield Case("load", "a 30 ms window of a recording in a separate file", partial(_windows_of_files, options))
    for count in (1_000, 10_000, *(() if options.quick else (100_000,))):
        for benchmark, again in (("opening a folder of recordings", True), ("opening it for the first time", False)):
            make = partial(_listing, options, count, again)
            yield Case("load", benchmark, make, size={"files": count}, axis="files", alone=True)


def _count(options: Options) -> int:
    return 200 if options.quick else 1_000


def folder(options: Options) -> Path:
    """Return a folder of recordings of ten classes in the layout of N-MNIST, which is written at the first call."""
    return _written(options.scratch / "N-MNIST", digits(options, 100), _count(options))


def _written(root: Path, events: list[Events], count: int) -> Path:
    done = root / "done"
    if not done.exists():
        for n in range(count):
            path = root / "Train" / str(n % 10) / f"{n:05d}.bin"
            path.parent.mkdir(parents=True, exist_ok=True)
            formats.write(events[n % len(events)], path)
        done.touch()
    return root


def _epoch(options: Options, workers: int, make: Callable[[Path], Any], library: str) -> PreparedCase:
    from torch.utils.data import DataLoader

    dataset = make(folder(options))
    loader: DataLoader[Any] = DataLoader(dataset, BATCH, num_workers=workers, persistent_workers=workers > 0)

    def run() -> np.ndarray:
        return np.asarray(sum(frames.sum(0) for frames, _ in loader))

    given = digits(options, 100)
    expected = sum(_counts(given[n % len(given)]) for n in range(len(dataset)))
    if library != OURS:
        # OFF first
        expected = expected[:, ::-1]
    return PreparedCase(run, lambda found: float(np.abs(found - expected).max()))


def _counts(events: Events) -> Any:
    """Count the events of each bin, polarity (ON first) and pixel with NumPy."""
    counts = np.zeros((BINS, 2, *DIGITS[::-1]))
    bins = np.minimum((events.t - events.start) * BINS // max(events.end - events.start, 1), BINS - 1)
    np.add.at(counts, (bins, 1 - events.p, events.y, events.x), 1)
    return counts


def _ours(root: Path) -> Any:
    return NMNIST(root, "all", transform=T.ToFrames(BINS))


def _ours_kept(root: Path) -> Any:
    return cache(_ours(root), root.parent / "cache")


def _tonic(kind: str, root: Path) -> Any:
    from nvsdata.benchmarks.peers import digits as theirs

    return getattr(theirs, kind)(root, BINS)


_MADE: dict[str, Callable[[Path], Any]] = {OURS: _ours, "tonic": partial(_tonic, "Digits")}
_KEPT: dict[str, Callable[[Path], Any]] = {
    OURS: _ours_kept,
    "tonic": partial(_tonic, "on_disk"),
    "tonic, in memory": partial(_tonic, "in_memory"),
}


def _graphs(options: Options, workers: int) -> PreparedCase:
    from torch.utils.data import DataLoader

    pipeline = T.Compose([T.RandomWindow(30_000), T.RadiusGraph()])
    dataset = NMNIST(folder(options), "all", transform=pipeline)
    loader: DataLoader[Any] = DataLoader(
        dataset, BATCH, num_workers=workers, collate_fn=collate, persistent_workers=workers > 0
    )
    return PreparedCase(lambda: sum(len(targets) for _, targets in loader))


def _windows_of_files(options: Options) -> PreparedCase:
    return _random_samples(NMNIST(folder(options), "all", transform=T.RandomWindow(30_000)))


def _listing(options: Options, count: int, again: bool) -> PreparedCase:
    """Prepare a dataset of empty files in the layout of ASL-DVS."""
    root = options.scratch / f"tree-{count}"
    if not root.exists():
        for n in range(count):
            letter = ASLDVS.info.classes[n % 24]
            (root / letter).mkdir(parents=True, exist_ok=True)
            (root / letter / f"{letter}_{n:06d}.mat").touch()
        # the index ignores folders that changed a moment ago; those of users are older
        for folder_ in (*root.iterdir(), root):
            os.utime(folder_, ns=(10**18, 10**18))
    before = None if again else lambda: (root / INDEX).unlink(missing_ok=True)
    return PreparedCase(lambda: len(ASLDVS(root, "all")), lambda found: abs(found - count), before)


def _windows_of_store(options: Options, count: int) -> PreparedCase:
    """Prepare a store of `count` recordings of 40 events each, so that a million fit on any disk."""
    path = options.scratch / f"store-{count}.nvs"
    if not path.exists():
        short = _written(options.scratch / "short", [events[:FIRST] for events in digits(options, 100)], 100)
        pack(NMNIST(short, "all"), path)
        _repeat(path, count)
    return _random_samples(NMNIST(path, "all", transform=T.RandomWindow(30_000)))


def _repeat(path: Path, count: int) -> None:
    """Repeat the recordings of a store under other names, up to `count` or a few more."""
    from nvsdata.datasets.store.index import BEGIN, file_head, index_place, packed_index, unpacked_index

    whole = path.read_bytes()
    place, length, _ = index_place(whole[:BEGIN], len(whole))
    index = unpacked_index(whole[place : place + length])
    known = len(index["name"])
    times = -(-count // known)
    shifts = np.arange(times)[:, None] * (place - BEGIN)
    for name in ("bytes", "check"):
        index[name] = np.tile(index[name], times)
    index["place"] = np.append(index["place"][:-1] + shifts, BEGIN + times * (place - BEGIN))
    index["name"] = [f"Train/{n % 10}/{n:07d}.bin" for n in range(known * times)]
    facts = {name: index.pop(name) for name in ("dataset", "split", "fold")}
    packed = packed_index(facts, **index)
    with path.open("wb") as file:
        file.write(file_head(int(index["place"][-1]), packed))
        for _ in range(times):
            file.write(whole[BEGIN:place])
        file.write(packed)


def _random_samples(dataset: Any) -> PreparedCase:
    """Prepare single samples in random order."""
    order = cycle(np.random.default_rng(0).integers(0, len(dataset), 4_096).tolist())
    return PreparedCase(lambda: dataset[next(order)])
