"""Where a dataset's files are: a folder, listed once and remembered, or a packed store."""

from __future__ import annotations

import json
import os
import random
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol

from nvsdata import formats
from nvsdata.common.files import atomic, crc32, read_own, sweep
from nvsdata.data.recording import Recording

INDEX, VERSION = ".nvsdata-index.json", 2
MOST_BYTES = 1 << 28  # of an index: of two million files
LOOKED_AT = 3  # folders that are compared with their index
REMEMBERED = 2_000  # with at least this many files, an index is worth its disk space
SETTLED_NS = 2_000_000_000  # a folder that changed this shortly before its listing may change again with the same time
CACHE_TAG = "CACHEDIR.TAG"  # marks folders of caches, by a convention of backup programs
DEEPEST = 8  # levels of folders, in case links form a cycle

Listing = dict[str, list[str]]
"""Folder, relative to the root with slashes, to its sorted file names."""


def path_below(folder: str, name: str) -> str:
    """Path of a listed file below the root."""
    return name if folder == "." else f"{folder}/{name}"


def recordings_in(listing: Listing) -> Iterator[str]:
    """Paths of the listed files that have the extension of a known format."""
    known = formats.suffixes()
    for folder, names in listing.items():
        prefix = path_below(folder, "")
        yield from [prefix + name for name in names if name.endswith(known) or name.lower().endswith(known)]


class Source(Protocol):
    """Files by their path relative to the root, with slashes."""

    root: Path
    split: str  # whose recordings it holds
    left_out: dict[str, str]  # recordings that are listed but not available, name to reason

    def listing(self) -> Listing:
        """All files except hidden ones; folders without files are listed, too."""

    def open(self, name: str, sensor_size: tuple[int, int] | None, *, strict: bool = True) -> Recording:
        """The recording with that name; unless `strict`, a partly damaged one is read without the damaged part."""

    def data(self, name: str) -> bytes:
        """The bytes of a small file that is not a recording."""

    def size(self, name: str) -> int:
        """Bytes of a file, or an equivalent, by which empty recordings are recognized."""

    def stamp(self, name: str) -> tuple[int, ...]:
        """Numbers that change when the recording does."""

    def settled(self, name: str, at: int) -> bool:
        """Whether a recording read at time `at` (ns since 1970) certainly had the content its stamp stands for."""


def save_index(path: Path, content: dict[str, Any]) -> None:
    """Keep what is known of a dataset's folder in a file of JSON, with a checksum. OSError if it can't be written."""
    text = json.dumps(content)
    sweep(path.parent, path.name)
    with atomic(path) as temporary:
        temporary.write_text(json.dumps([VERSION, crc32(text.encode())]) + "\n" + text)


def load_index(path: Path) -> dict[str, Any]:
    """Return what `keep` kept: an empty dictionary if there is nothing of this version, or it was changed since."""
    try:
        head, _, text = read_own(path, MOST_BYTES).partition(b"\n")
        content = json.loads(text) if json.loads(head) == [VERSION, crc32(text)] else {}
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _entered(folder: str, folders: list[str]) -> list[str]:
    """The folders in a folder that are looked into."""
    return [f for f in folders if not f.startswith((".", "__"))] if folder.count("/") < DEEPEST else []


def _shown(names: Iterable[str]) -> list[str]:
    return sorted(name for name in names if not name.startswith("."))


def _is_listed(folder: str, names: list[str]) -> bool:
    """Whether an entry of an index names a folder below the root, and files in it."""
    parts = [] if folder == "." else folder.split("/")
    # a dot and two dots lead elsewhere
    return all(part.strip(".") and not {"/", os.sep, "\0"} & set(part) for part in (*parts, *names))


class Folder:
    """Files below a folder."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.split = "all"
        self.left_out: dict[str, str] = {}

    def listing(self) -> Listing:
        """All files except hidden ones, from the index in the root if no folder has changed since it was made."""
        remembered = self._remembered()
        if remembered is not None:
            return remembered
        made = time.time_ns()
        found: Listing = {}
        times: dict[str, int] = {}
        for parent, folders, names in os.walk(self.root, followlinks=True):
            folder = os.path.relpath(parent, self.root).replace(os.sep, "/")
            if folder != "." and CACHE_TAG in names:
                folders.clear()
                continue
            times[folder] = os.stat(parent).st_mtime_ns
            folders[:] = _entered(folder, folders)
            found[folder] = _shown(names)
        found = {folder: found[folder] for folder in sorted(found)}
        if sum(map(len, found.values())) >= REMEMBERED:
            self._remember(made, times, found)
        return found

    def _remembered(self) -> Listing | None:
        """The listing of the index; None if there is none, a folder has changed, or it isn't one of this folder."""
        try:
            index = load_index(self.root / INDEX)
            times, files = index["times"], index["files"]
            if not (times.keys() == files.keys() and "." in files and all(map(_is_listed, files, files.values()))):
                return None
            for folder, changed in times.items():
                # writing the index itself changes the root after it was listed
                now = os.stat(self.root / folder).st_mtime_ns
                if now != changed or now > index["made"] - SETTLED_NS:
                    return None
            some = random.Random().sample(list(files), min(len(files), LOOKED_AT))
            return files if all(self._is_same(folder, files) for folder in some) else None
        except (OSError, KeyError, TypeError, AttributeError):
            return None

    def _is_same(self, folder: str, files: Listing) -> bool:
        """Whether a folder has the files of an index, and its folders are in the index, too."""
        with os.scandir(self.root / folder) as entries:
            found = {entry.name: entry.is_dir() for entry in entries}
        if files[folder] != _shown(name for name, is_folder in found.items() if not is_folder):
            return False
        below = _entered(folder, [name for name, is_folder in found.items() if is_folder])
        return all(
            path_below(folder, name) in files or (self.root / folder / name / CACHE_TAG).exists() for name in below
        )

    def _remember(self, made: int, times: dict[str, int], files: Listing) -> None:
        try:
            save_index(self.root / INDEX, {"made": made, "times": times, "files": files})
            # otherwise the root would seem to have changed
            os.utime(self.root, ns=(time.time_ns(), times["."]))
        except OSError:
            pass  # a folder that can't be written to is listed again each time

    def open(self, name: str, sensor_size: tuple[int, int] | None, *, strict: bool = True) -> Recording:
        """The recording with that name."""
        return formats.open(os.path.join(self.root, name), sensor_size=sensor_size, strict=strict)

    def data(self, name: str) -> bytes:
        """The bytes of a small file that is not a recording."""
        return (self.root / name).read_bytes()

    def size(self, name: str) -> int:
        """Bytes of the file."""
        return os.stat(self.root / name).st_size

    def stamp(self, name: str) -> tuple[int, ...]:
        """Size of the file in bytes, and when it was changed."""
        status = os.stat(os.path.join(self.root, name))
        return status.st_size, status.st_mtime_ns

    def settled(self, name: str, at: int) -> bool:
        """Whether the file wasn't changed around `at`; otherwise it may change again within one tick of the clock."""
        return abs(at - self.stamp(name)[1]) > SETTLED_NS
