"""Files that nvsdata keeps on disk: finding and removing caches, indexes and remains of killed processes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from nvsdata.common.files import PART, is_left_over, read_own
from nvsdata.common.locks import OutputInUse, is_dead_lock, is_locked, locked, remove_dead_lock
from nvsdata.datasets.archives.download import WORK
from nvsdata.datasets.cache.cached import TAG
from nvsdata.datasets.source import CACHE_TAG, INDEX
from nvsdata.datasets.store.part import DATA, JOURNAL
from nvsdata.datasets.store.second import COLUMNS as SECOND
from nvsdata.formats.index_cache import SUFFIX
from nvsdata.remote.blocks import FILES as BLOCKS
from nvsdata.remote.blocks import TAG as BLOCKS_TAG

# path of a sample in a cache: key, shard and number, as `Cached` names them; or its temporary file of a killed process
SAMPLE = re.compile(r"[0-9a-f]{16}/\d+/(\d+\.pt|\.\d+\.pt\..*\.part)")
TAGS = {"samples": TAG, "blocks": BLOCKS_TAG}
FILES = {"samples": SAMPLE, "blocks": BLOCKS}


class Kept(NamedTuple):
    """Files of one kind that nvsdata keeps in one place.

    Attributes:
        kind: "samples", "blocks" (of remote files), "index", "leftover" or "unfinished" (a store or a download, which
            the same command resumes).
        path: the folder that contains the files, or the only file.
        files: paths of all files.
        bytes: size of all files together.
    """

    kind: str
    path: Path
    files: list[Path]
    bytes: int


def kept_below(folder: Path) -> Iterator[Kept]:
    """Yield caches of samples and blocks, indexes of recordings, datasets and windows, and remains of killed processes.

    Files that a running process writes are left out. FileNotFoundError if there is no such folder.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder")
    for place, folders, names in os.walk(folder):
        here = Path(place)
        if CACHE_TAG in names and (kind := _kind_of(here / CACHE_TAG)) is not None:
            # other files in the folder are a user's and stay
            ours = [path for path in here.rglob("*") if FILES[kind].fullmatch(path.relative_to(here).as_posix())]
            # the tag is removed last: without it, the rest of an interrupted clearing couldn't be found
            yield _kept(kind, here, [*ours, here / CACHE_TAG])
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
    """Return whether this is the name of an index: of a dataset's folder, of windows, or of a recording."""
    windows = name.startswith(".nvsdata-windows-") and name.endswith(".json")
    return name == INDEX or windows or (name.startswith(".") and name.endswith(SUFFIX))


def _is_unfinished(folder: Path) -> bool:
    """Return whether a folder contains an interrupted packing or download, and nothing else."""
    output = _output_of(folder)
    return output is not None and not is_locked(output)


def _output_of(folder: Path) -> Path | None:
    """Return the output of the unfinished store or download in this folder; None if the folder is neither."""
    if folder.is_symlink():
        return None
    if folder.name == WORK:
        return folder.parent
    if not (folder.name.startswith(".") and folder.name.endswith(PART)):
        return None
    # a process killed while it made or removed the folder leaves only some of these files
    ours = {path.name for path in folder.iterdir()} <= {DATA, JOURNAL, *SECOND}
    return folder.with_name(folder.name[1 : -len(PART)]) if ours else None


def remove_kept(kept: Kept) -> None:
    """Delete the files, and then the empty folders of a cache, store or download.

    Files that a process has taken over in the meantime stay.
    """
    output = _output_of(kept.path) if kept.kind == "unfinished" else None
    if output is None:
        _remove(kept)
        return
    with suppress(OutputInUse), locked(output):
        _remove(kept)


def _remove(kept: Kept) -> None:
    for path in kept.files:
        if kept.kind == "leftover" and path.suffix == ".lock":
            remove_dead_lock(path)
        else:
            path.unlink(missing_ok=True)
    if kept.kind in ("samples", "blocks", "unfinished"):
        within = {folder for path in kept.files for folder in path.parents if kept.path in folder.parents}
        for folder in (*sorted(within, key=lambda folder: -len(folder.parts)), kept.path):
            # a folder stays if a process uses the cache, or a user has put something there
            with suppress(OSError):
                folder.rmdir()


def _kind_of(tag: Path) -> str | None:
    """Return the kind of the cache that a file marks; None if it isn't one of nvsdata's."""
    with suppress(OSError):
        found = read_own(tag, max(map(len, TAGS.values())))
        return next((kind for kind, content in TAGS.items() if content == found), None)
    return None


def _kept(kind: str, path: Path, files: list[Path]) -> Kept:
    size = 0
    for file in files:
        with suppress(OSError):
            size += file.lstat().st_size
    return Kept(kind, path, files, size)
