"""Cached indexes of large files, next to them: `.NAME.nvsdata-index`, which may be deleted at any time.

Some indexes need a pass over the entire file. With a cached index, the next process, or another worker of a DataLoader,
reads a window without that pass. The pass is repeated if the file or the version of this module has changed, if the
folder can't be written to, and if the index is damaged or was altered. To detect that, an index has a checksum, and
formats compare some of its entries, and the entries at the ends of each window, with the file.
"""

from __future__ import annotations

import json
import os
import time
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np

from nvsdata.common.files import MOST, PART, atomic, crc32, read_own, sweep

VERSION = 2  # version of the cached arrays, and of the kernels that compute them
LEAST = 1 << 23  # bytes; indexes of smaller files aren't cached, because the pass takes less than 20 ms
SETTLED_NS = 2_000_000_000  # a file that changed more recently may change again without another time stamp
COMPARED = 8  # random entries of an index that are compared with the file when it is loaded
SUFFIX = ".nvsdata-index"

Arrays = dict[str, np.ndarray]


def path_of(path: str) -> Path:
    """Return the path of a file's index."""
    folder, name = os.path.split(path)
    return Path(folder, f".{name}{SUFFIX}")


def entries_to_compare(count: int) -> np.ndarray:
    """Return the indices of entries, of `count`, to compare with the file: the first, the last and random ones."""
    inner = np.random.default_rng().integers(0, max(count, 1), COMPARED)
    return np.unique(np.append(inner, (0, count - 1))) if count else inner[:0]


def load_index(path: str, about: dict[str, object], most: int = MOST) -> Arrays | None:
    """Return the arrays cached for the file `path` with the description `about`.

    None if there are no valid ones, or if they take more than `most` bytes.
    """
    try:
        content = read_own(path_of(path), most)
        with zipfile.ZipFile(BytesIO(content)) as archive:
            # nvsdata doesn't compress these arrays
            if sum(entry.file_size for entry in archive.infolist()) > len(content):
                return None
        with np.load(BytesIO(content), allow_pickle=False) as kept:
            arrays = {name: kept[name] for name in kept.files if name not in ("about", "crc")}
            known = bytes(kept["about"]) == _described(about) and int(kept["crc"]) == _checksum(arrays)
    except Exception:  # a damaged archive may raise anything
        return None
    return arrays if known else None


def save_index(path: str, about: dict[str, object], modified: int, arrays: Arrays) -> None:
    """Cache arrays for the file `path` with the description `about`, if it was last `modified` (ns) long enough ago."""
    if time.time_ns() - modified < SETTLED_NS or path.endswith(PART):
        return
    described = np.frombuffer(_described(about), np.uint8)
    try:
        # delete files of killed processes
        sweep(path_of(path).parent, path_of(path).name)
        with atomic(path_of(path)) as temporary, temporary.open("wb") as file:
            np.savez(file, about=described, crc=np.array(_checksum(arrays)), **arrays)  # type: ignore[arg-type]
    except OSError:
        # a read-only folder or disk: the next process repeats the pass
        return


def _checksum(arrays: Arrays) -> int:
    value = 0
    for name in sorted(arrays):
        value = crc32(np.ascontiguousarray(arrays[name]).tobytes(), crc32(name.encode(), value))
    return value


def _described(about: dict[str, object]) -> bytes:
    return json.dumps({"version": VERSION, **about}, sort_keys=True).encode()
