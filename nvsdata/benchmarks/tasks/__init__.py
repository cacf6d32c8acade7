"""Tasks of `nvsdata bench`, one module each."""

from __future__ import annotations

from importlib import import_module

from nvsdata.benchmarks.case import Case, Options

# modules of this package, and their description in `nvsdata bench --help`
TASKS = {
    "start": "time from the start of a process to its first result, and its memory",
    "decode": "reading event files, entire and in windows, and their size on disk",
    "load": "loading samples with a DataLoader, from files and from a packed store",
    "graph": "converting events to graphs",
    "represent": "converting events to frames, voxel grids, time surfaces and other tensors",
    "emulate": "emulating events from frames",
    "motion": "emulating events of a known motion, and errors of their times",
    "metrics": "distances between event streams",
    "layers": "single graph convolutions, forward and backward pass",
    "train": "training steps",
    "infer": "inference of networks, and classification of windows",
}


def cases_of(task: str, options: Options) -> list[Case]:
    """Return the cases of a task, grouped by benchmark."""
    found: list[Case] = import_module(f"nvsdata.benchmarks.tasks.{task}").cases(options)
    names = list(dict.fromkeys(case.benchmark for case in found))
    return sorted(found, key=lambda case: names.index(case.benchmark))
