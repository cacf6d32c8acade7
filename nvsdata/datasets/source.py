"""Sources of a dataset's files: the protocol `Source`, and `Folder`, which stores its listing in an index."""

from __future__ import annotations

import hashlib
import json
import os
import random
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from nvsdata import formats
from nvsdata.common.files import atomic, crc32, read_own, sweep
from nvsdata.data.recording import Recording

INDEX, VERSION = ".nvsdata-index.json", 2
MOST_BYTES = 1 << 28  # largest index that is read, for about two million files
COMPARED = 3  # random folders of an index that are compared with the disk
MANY_FILES = 2_000  # number of files from which an index is written
SETTLED_NS = 2_000_000_000  # a folder that changed more recently may change again without a new modification time
CACHE_TAG = "CACHEDIR.TAG"  # marks folders of caches, by a convention of backup programs
# in no listing's names joined by slashes: empty and hidden names, . and .., and what no name contains
UNLISTED = {"//", "/.", "\0", os.sep} - {"/"}
DEEPEST = 8  # levels of folders, in case links form a cycle

Listing = dict[str, list[str]]
"""Folder, relative to the root with slashes, to its sorted file names."""


def path_below(folder: str, name: str) -> str:
    """Return the path below the root of the file `name` in a listed `folder`."""
    return name if folder == "." else f"{folder}/{name}"


def recordings_in(listing: Listing) -> Iterator[str]:
    """Yield the paths of the listed files that have the extension of a known format."""
    known = formats.suffixes()
    for folder, names in listing.items():
        prefix = path_below(folder, "")
        yield from [prefix + name for name in names if name.endswith(known) or name.lower().endswith(known)]


class Recordings(Protocol):
    """Recordings of a source, by number. Pickling them for another process is cheap."""

    @property
    def names(self) -> Sequence[str]:
        """Their paths below the root."""

    @property
    def folders(self) -> Sequence[str]:
        """The folders that contain recordings."""

    @property
    def folder(self) -> np.ndarray:
        """The number of each recording's folder, unsigned integers [N]."""

    def sort(self, numbers: np.ndarray, *, by_file: bool) -> None:
        """Sort numbers of recordings, uint32, in place: by file name, then by folder; otherwise by path."""


class Source(Protocol):
    """A source of files: a folder or a packed store. Names are paths relative to the root, with slashes."""

    split: str  # split to which the recordings belong
    left_out: dict[str, str]  # recordings that are listed but not available, name to reason

    def listing(self) -> Listing:
        """Return all folders, including those without files, and their files, except hidden ones."""

    def recordings(self) -> Recordings | None:
        """Return the recordings, without listing files; None if they must be listed."""

    def open(self, name: str, sensor_size: tuple[int, int] | None, *, strict: bool = True) -> Recording:
        """Return a recording; unless `strict`, a partly damaged one is read without the damaged part."""

    def data(self, name: str) -> bytes:
        """Return the bytes of a small file that is not a recording."""

    def size(self, name: str) -> int:
        """Return the size of a file in bytes, by which empty recordings are recognized."""

    def content(self, name: str) -> tuple[int, ...]:
        """Return numbers that are equal for recordings of equal content."""

    def stamp(self, name: str) -> tuple[int, ...]:
        """Return numbers that change when the recording changes."""

    def settled(self, name: str, at: int) -> bool:
        """Return True if a recording's stamp identifies the content that was read at the time `at` (ns since 1970)."""


def save_facts(path: Path, content: dict[str, Any]) -> None:
    """Write facts about a dataset's folder to a JSON file with a checksum; OSError if it can't be written."""
    text = json.dumps(content)
    sweep(path.parent, path.name)
    with atomic(path) as temporary:
        temporary.write_text(json.dumps([VERSION, crc32(text.encode())]) + "\n" + text)


def load_facts(path: Path) -> dict[str, Any]:
    """Return the facts that `save_facts` wrote; empty if the file is missing, of another version, or was changed."""
    try:
        head, _, text = read_own(path, MOST_BYTES).partition(b"\n")
        content = json.loads(text) if json.loads(head) == [VERSION, crc32(text)] else {}
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _entered(folder: str, folders: list[str]) -> list[str]:
    """Return the subfolders `folders` of a folder that belong in a listing: not hidden, and not too deep."""
    return [f for f in folders if not f.startswith((".", "__"))] if folder.count("/") < DEEPEST else []


def _visible(names: Iterable[str]) -> list[str]:
    return sorted(name for name in names if not name.startswith("."))


def _is_listed(folder: str, names: list[str]) -> bool:
    """Return whether an entry of an index is valid: its folder is below the root, and its files are in the folder."""
    parts = [] if folder == "." else folder.split("/")
    # searches of one text, because there may be 100,000 names
    text = "/".join(("", *parts, *names, ""))
    return text.count("/") == len(parts) + len(names) + 1 and not any(wrong in text for wrong in UNLISTED)


class Folder:
    """A `Source` of the files below a folder."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.split = "all"
        self.left_out: dict[str, str] = {}

    def listing(self) -> Listing:
        """Return all files except hidden ones, from the index in the root if no folder has changed since."""
        known = self._from_index()
        if known is not None:
            return known
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
            found[folder] = _visible(names)
        found = {folder: found[folder] for folder in sorted(found)}
        if sum(map(len, found.values())) >= MANY_FILES:
            self._write_index(made, times, found)
        return found

    def _from_index(self) -> Listing | None:
        """Return the listing stored in the index; None without an index, or if it doesn't match the folder."""
        try:
            index = load_facts(self.root / INDEX)
            times, files = index["times"], index["files"]
            if not (times.keys() == files.keys() and "." in files and all(map(_is_listed, files, files.values()))):
                return None
            for folder, changed in times.items():
                # a folder that changed shortly before it was listed may have changed again since, with the same time
                now = os.stat(self.root / folder).st_mtime_ns
                if now != changed or now > index["made"] - SETTLED_NS:
                    return None
            some = random.Random().sample(list(files), min(len(files), COMPARED))
            return files if all(self._is_same(folder, files) for folder in some) else None
        except (OSError, KeyError, TypeError, AttributeError):
            return None

    def _is_same(self, folder: str, files: Listing) -> bool:
        """Return whether a folder has the files of an index, and its subfolders are in the index."""
        with os.scandir(self.root / folder) as entries:
            found = {entry.name: entry.is_dir() for entry in entries}
        if files[folder] != _visible(name for name, is_folder in found.items() if not is_folder):
            return False
        below = _entered(folder, [name for name, is_folder in found.items() if is_folder])
        return all(
            path_below(folder, name) in files or (self.root / folder / name / CACHE_TAG).exists() for name in below
        )

    def _write_index(self, made: int, times: dict[str, int], files: Listing) -> None:
        try:
            save_facts(self.root / INDEX, {"made": made, "times": times, "files": files})
            # writing the index changed the time of the root
            os.utime(self.root, ns=(time.time_ns(), times["."]))
        except OSError:
            pass  # a folder that can't be written to is listed again each time

    def recordings(self) -> None:
        """Return None: files must be listed."""

    def open(self, name: str, sensor_size: tuple[int, int] | None, *, strict: bool = True) -> Recording:
        """Return the recording called `name`, opened but not decoded."""
        return formats.open(os.path.join(self.root, name), sensor_size=sensor_size, strict=strict)

    def data(self, name: str) -> bytes:
        """Return the bytes of a small file that is not a recording."""
        return (self.root / name).read_bytes()

    def size(self, name: str) -> int:
        """Return the size of the file in bytes."""
        return os.stat(self.root / name).st_size

    def content(self, name: str) -> tuple[int, ...]:
        """Return a hash of the file's bytes."""
        with open(self.root / name, "rb") as file:
            return tuple(hashlib.file_digest(file, "blake2b").digest()[:16])

    def stamp(self, name: str) -> tuple[int, ...]:
        """Return the size of the file in bytes and its modification time in ns."""
        status = os.stat(os.path.join(self.root, name))
        return status.st_size, status.st_mtime_ns

    def settled(self, name: str, at: int) -> bool:
        """Return True if the file was last changed well before or after `at` (ns since 1970).

        A file that changed shortly before `at` may change again without a new modification time.
        """
        return abs(at - self.stamp(name)[1]) > SETTLED_NS
