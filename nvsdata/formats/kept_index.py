"""Indices of large files, kept beside them: `.NAME.nvsdata-index`, which may be deleted at any time.

Where an index takes a pass over the whole file, it is worth keeping: the next process, or a DataLoader's next worker,
reads a window without that pass. A file that changed since, another version of this module, a folder that can't be
written and a broken index only mean that the pass is made again.
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import numpy as np

from nvsdata.common.files import PART, atomic, sweep

VERSION = 1  # of what is kept, and of the kernels that make it
LEAST = 1 << 23  # bytes; the pass over smaller files takes less than 20 ms
SETTLED_NS = 2_000_000_000  # a file changed more recently may change again with the same stamp

Arrays = dict[str, np.ndarray]


def path_of(path: str) -> Path:
    """Where the index of a file is kept."""
    folder, name = os.path.split(path)
    return Path(folder, f".{name}.nvsdata-index")


def restore(path: str, about: dict[str, object]) -> Arrays | None:
    """The arrays that were kept for a file with these facts `about` it; None if there are none."""
    try:
        with np.load(path_of(path), allow_pickle=False) as kept:
            if bytes(kept["about"]) != _described(about):
                return None
            return {name: kept[name] for name in kept.files if name != "about"}
    except Exception:  # a broken archive raises anything
        return None


def keep(path: str, about: dict[str, object], modified: int, arrays: Arrays) -> None:
    """Keep arrays for a file that was `modified` at a time (ns since 1970), if that is long enough ago."""
    if time.time_ns() - modified < SETTLED_NS or path.endswith(PART):
        return
    described = np.frombuffer(_described(about), np.uint8)
    try:
        # what killed processes left
        sweep(path_of(path).parent, path_of(path).name)
        with atomic(path_of(path)) as temporary, temporary.open("wb") as file:
            np.savez(file, about=described, **arrays)  # type: ignore[arg-type]
    except OSError:
        # a folder or a disk for reading only: nothing is lost but time
        return


def _described(about: dict[str, object]) -> bytes:
    return json.dumps({"version": VERSION, **about}, sort_keys=True).encode()
