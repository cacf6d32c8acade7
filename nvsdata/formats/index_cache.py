"""Indexes of large files, kept next to them: `.NAME.nvsdata-index`, which may be deleted at any time.

Where an index takes a pass over the entire file, it is worth keeping: the next process, or a DataLoader's next worker,
reads a window without that pass. A file that changed since, another version of this module, a folder that can't be
written and a broken index only mean that the pass is made again. So does an index that somebody altered: it has a
checksum, and formats compare some of its entries with the file, and those at the ends of each window.
"""

from __future__ import annotations

import json
import os
import time
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np

from nvsdata.common.checksum import crc32
from nvsdata.common.files import MOST, PART, atomic, read_own, sweep

VERSION = 2  # of what is kept, and of the kernels that make it
LEAST = 1 << 23  # bytes; the pass over smaller files takes less than 20 ms
SETTLED_NS = 2_000_000_000  # a file changed more recently may change again with the same stamp
COMPARED = 8  # entries of an index that are compared with the file when it is restored
SUFFIX = ".nvsdata-index"

Arrays = dict[str, np.ndarray]


def path_of(path: str) -> Path:
    """Return where the index of a file is kept."""
    folder, name = os.path.split(path)
    return Path(folder, f".{name}{SUFFIX}")


def entries_to_compare(count: int) -> np.ndarray:
    """Return which of `count` entries of an index to compare with the file: the first, the last and some at random."""
    inner = np.random.default_rng().integers(0, max(count, 1), COMPARED)
    return np.unique(np.append(inner, (0, count - 1))) if count else inner[:0]


def load_index(path: str, about: dict[str, object], most: int = MOST) -> Arrays | None:
    """Return the arrays kept for a file with these facts `about` it; None if there are none, or over `most` bytes."""
    try:
        content = read_own(path_of(path), most)
        with zipfile.ZipFile(BytesIO(content)) as archive:
            # arrays are kept as they are: a compressed one isn't ours
            if sum(entry.file_size for entry in archive.infolist()) > len(content):
                return None
        with np.load(BytesIO(content), allow_pickle=False) as kept:
            arrays = {name: kept[name] for name in kept.files if name not in ("about", "crc")}
            known = bytes(kept["about"]) == _described(about) and int(kept["crc"]) == _checksum(arrays)
    except Exception:  # a broken archive raises anything
        return None
    return arrays if known else None


def save_index(path: str, about: dict[str, object], modified: int, arrays: Arrays) -> None:
    """Keep arrays for a file that was `modified` at a time (ns since 1970), if that is long enough ago."""
    if time.time_ns() - modified < SETTLED_NS or path.endswith(PART):
        return
    described = np.frombuffer(_described(about), np.uint8)
    try:
        # what killed processes left
        sweep(path_of(path).parent, path_of(path).name)
        with atomic(path_of(path)) as temporary, temporary.open("wb") as file:
            np.savez(file, about=described, crc=np.array(_checksum(arrays)), **arrays)  # type: ignore[arg-type]
    except OSError:
        # a folder or a disk for reading only: nothing is lost but time
        return


def _checksum(arrays: Arrays) -> int:
    value = 0
    for name in sorted(arrays):
        value = crc32(np.ascontiguousarray(arrays[name]).tobytes(), crc32(name.encode(), value))
    return value


def _described(about: dict[str, object]) -> bytes:
    return json.dumps({"version": VERSION, **about}, sort_keys=True).encode()
