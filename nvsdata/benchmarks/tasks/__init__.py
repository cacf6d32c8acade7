"""Tasks that can be measured, one module each."""

from __future__ import annotations

from importlib import import_module

from nvsdata.benchmarks.case import Case, Options

# a module of this package each, and what `nvsdata bench --help` says of it
TASKS = {
    "start": "new processes to their first result, and their memory",
    "decode": "files of events, whole and in windows, and what they take on disk",
    "load": "samples through a DataLoader, from files and from a packed store",
    "graph": "events to graphs",
    "represent": "events to frames, voxel grids, surfaces and other tensors",
    "emulate": "frames to events",
    "motion": "frames of a known motion to events, and how far these are from their true times",
    "metrics": "distances between streams of events",
    "layers": "single graph convolutions, forward and backward",
    "train": "steps of training",
    "infer": "networks' scores, and windows of recordings to classes",
}


def cases_of(task: str, options: Options) -> list[Case]:
    """The cases of a task, those of the same work together."""
    found: list[Case] = import_module(f"nvsdata.benchmarks.tasks.{task}").cases(options)
    works = list(dict.fromkeys(case.work for case in found))
    return sorted(found, key=lambda case: works.index(case.work))
