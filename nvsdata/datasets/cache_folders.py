"""What nvsdata keeps on disk to be faster, and what killed processes left."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from nvsdata.common.files import is_left_over
from nvsdata.datasets.cache import TAG
from nvsdata.datasets.source import CACHE_TAG, INDEX

# key of the cache, shard and sample, as `Cached` names them; or one that a killed process was writing
SAMPLE = re.compile(r"[0-9a-f]{16}/\d+/(\d+\.pt|\.\d+\.pt\..*\.part)")


class Kept(NamedTuple):
    """Files of one kind in one place.

    - `kind`: "samples", "index", "leftover" or "kernels"
    - `path`: the place
    - `files`: all of them
    - `bytes`: that they take
    """

    kind: str
    path: Path
    files: list[Path]
    bytes: int


def caches_below(folder: Path) -> Iterator[Kept]:
    """Caches of samples (`nvsdata.cache`), indexes of datasets and of windows, and leftovers of killed processes.

    FileNotFoundError if there is no such folder.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder")
    for place, folders, names in os.walk(folder):
        here = Path(place)
        if CACHE_TAG in names and _is_ours(here / CACHE_TAG):
            # what a user put beside them stays
            samples = [path for path in here.rglob("*") if SAMPLE.fullmatch(path.relative_to(here).as_posix())]
            yield _kept("samples", here, [here / CACHE_TAG, *samples])
            folders.clear()
            continue
        for name in sorted(names):
            if name == INDEX or (name.startswith(".nvsdata-windows-") and name.endswith(".json")):
                yield _kept("index", here / name, [here / name])
            elif is_left_over(here / name):
                yield _kept("leftover", here / name, [here / name])


def kernels() -> Kept:
    """Compiled kernels of this installation."""
    own = Path(__file__).parents[1] / "kernels"
    root = Path(os.environ.get("NUMBA_CACHE_DIR") or own)
    # numba names files after the module's, in folders that it names after the module's folder
    stems = {path.stem for path in own.glob("*.py")}
    found = [path for kind in ("nbi", "nbc") for path in root.rglob(f"*.{kind}")]
    here = [path for path in found if path.name.partition(".")[0] in stems]
    return _kept("kernels", root, [path for path in here if "kernels" in path.parent.name or own in path.parents])


def remove(kept: Kept) -> None:
    """Delete the files, and the folders of a cache of samples that are empty then."""
    for path in kept.files:
        path.unlink(missing_ok=True)
    if kept.kind == "samples":
        within = {folder for path in kept.files for folder in path.parents if kept.path in folder.parents}
        for folder in (*sorted(within, key=lambda folder: -len(folder.parts)), kept.path):
            # a process that uses the cache, or a user, may have put something there
            with suppress(OSError):
                folder.rmdir()


def _is_ours(tag: Path) -> bool:
    with suppress(OSError):
        return tag.read_bytes() == TAG
    return False


def _kept(kind: str, path: Path, files: list[Path]) -> Kept:
    size = 0
    for file in files:
        with suppress(OSError):
            size += file.stat().st_size
    return Kept(kind, path, files, size)
