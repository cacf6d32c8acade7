"""What nvsdata keeps on disk to be faster, and what killed processes left."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from nvsdata.common.files import PART, is_left_over
from nvsdata.common.locks import is_dead_lock, is_locked
from nvsdata.datasets.archives.download import WORK
from nvsdata.datasets.cache import TAG
from nvsdata.datasets.source import CACHE_TAG, INDEX
from nvsdata.datasets.store.part import JOURNAL
from nvsdata.datasets.store.reader import COLUMNS
from nvsdata.formats.kept_index import SUFFIX

# key of the cache, shard and sample, as `Cached` names them; or one that a killed process was writing
SAMPLE = re.compile(r"[0-9a-f]{16}/\d+/(\d+\.pt|\.\d+\.pt\..*\.part)")


class Kept(NamedTuple):
    """Files of one kind in one place.

    - `kind`: "samples", "index", "leftover", "unfinished" (a store or a download, which the same command resumes) or
      "kernels"
    - `path`: the place
    - `files`: all of them
    - `bytes`: that they take
    """

    kind: str
    path: Path
    files: list[Path]
    bytes: int


def caches_below(folder: Path) -> Iterator[Kept]:
    """Caches of samples (`nvsdata.cache`), indexes of recordings, datasets and windows, and what killed processes left.

    What a running process writes isn't among them. FileNotFoundError if there is no such folder.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder")
    for place, folders, names in os.walk(folder):
        here = Path(place)
        if CACHE_TAG in names and _is_ours(here / CACHE_TAG):
            # what a user put beside them stays
            samples = [path for path in here.rglob("*") if SAMPLE.fullmatch(path.relative_to(here).as_posix())]
            # the tag last: without it, a clearing that was killed couldn't be continued
            yield _kept("samples", here, [*samples, here / CACHE_TAG])
            folders.clear()
            continue
        for name in sorted(names):
            if _is_index(name) and (here / name).is_file() and not (here / name).is_symlink():
                yield _kept("index", here / name, [here / name])
            elif is_left_over(here / name) or is_dead_lock(here / name):
                yield _kept("leftover", here / name, [here / name])
        for name in sorted(folders):
            if _is_unfinished(here / name):
                folders.remove(name)
                yield _kept("unfinished", here / name, [path for path in (here / name).rglob("*") if path.is_file()])


def _is_index(name: str) -> bool:
    """Whether nvsdata gives this name to an index: of a dataset's folder, of windows, or of a recording."""
    windows = name.startswith(".nvsdata-windows-") and name.endswith(".json")
    return name == INDEX or windows or (name.startswith(".") and name.endswith(SUFFIX))


def _is_unfinished(folder: Path) -> bool:
    """Whether a folder is that of a packing or a download that ended, and that nothing else is in it."""
    if folder.is_symlink():
        return False
    if folder.name == WORK:
        return not is_locked(folder.parent)
    if not (folder.name.startswith(".") and folder.name.endswith(PART)):
        return False
    names = {path.name for path in folder.iterdir()}
    # one that was killed while it made or removed the folder has left some of them
    return names <= {*COLUMNS, JOURNAL} and not is_locked(folder.with_name(folder.name[1 : -len(PART)]))


def kernels() -> Kept:
    """Compiled kernels of this installation."""
    from nvsdata.kernels.compiling import nothing

    # a folder for the modules of this installation's folder of kernels, wherever numba has put it
    place = Path(getattr(getattr(nothing, "_cache", None), "cache_path", None) or Path(__file__).parents[1] / "kernels")
    return _kept("kernels", place, [path for kind in ("nbi", "nbc") for path in place.glob(f"*.{kind}")])


def remove(kept: Kept) -> None:
    """Delete the files, and the folders of a cache of samples that are empty then."""
    for path in kept.files:
        path.unlink(missing_ok=True)
    if kept.kind in ("samples", "unfinished"):
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
