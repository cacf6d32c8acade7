"""Copies of packed stores on remote file systems, with a dataset card."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from nvsdata.common.errors import FormatError, shown
from nvsdata.common.progress import bar
from nvsdata.common.terminal import say
from nvsdata.datasets.store.card import dataset_card
from nvsdata.datasets.store.index import BEGIN, index_place
from nvsdata.datasets.store.opened import opened_index
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.shards import shard_places
from nvsdata.remote import transport
from nvsdata.remote.transport import read_range, repeated
from nvsdata.remote.url import WEB, Url

CARD = "README.md"
SLOWER = 8  # times as long that sending may take, compared with reading


class Pushed(NamedTuple):
    """Result of `push`.

    Attributes:
        sent: names of the files that were sent.
        kept: names of the files that were there.
    """

    sent: list[str]
    kept: list[str]


def push(stores: Sequence[str | os.PathLike[str]], url: str, *, overwrite: bool = False) -> Pushed:
    """Copy packed stores into a remote folder, with a dataset card, README.md.

    Of an index file, its shards are copied, too. Every checksum is verified before a file is sent. Afterwards, its
    size, head and index are read back. Files that are there already aren't sent again, so repeating the call continues
    after the last complete file.

    Args:
        stores: the stores, in the third layout.
        url: URL of the folder, such as hf://datasets/user/name or s3://bucket/folder.
        overwrite: whether to replace other files with these names. Otherwise an existing README.md is kept.

    Returns:
        The names of the files that were sent, and of those that were there.

    Raises:
        FileExistsError: another file has the name of a store, unless `overwrite`.
        FormatError: a store is damaged.
        ValueError: the URL is of a web server, which takes no files.
        OSError: the server fails.

    Example:
        >>> push(["n-mnist.nvs"], "hf://datasets/user/name")  # doctest: +SKIP
    """
    folder = Url(url)
    if folder.scheme in WEB:
        raise ValueError(
            f"{folder}: a web server takes no files: give the URL of the store itself (s3://, gs://, hf://)"
        )
    given = [Path(path).expanduser() for path in stores]
    files = dict.fromkeys(file for path in given for file in _files_of(path))
    if len({file.name for file in files}) < len(files):
        raise ValueError("two files have the same name")
    sent, kept = list[str](), list[str]()
    for file in files:
        (sent if _send(file, folder.child(file.name), overwrite) else kept).append(file.name)
    card = dataset_card(given, folder).encode()
    there = _content(folder.child(CARD))
    if there is not None and (there == card or not overwrite):
        if there != card:
            say(f"{folder.child(CARD)} is kept: --overwrite (in Python overwrite=True) replaces it")
        kept.append(CARD)
    else:
        repeated(folder.child(CARD), lambda system, path: system.pipe_file(path, card))
        sent.append(CARD)
    return Pushed(sent, kept)


def _files_of(path: Path) -> Iterator[Path]:
    """Yield the files of a store, the index file after its shards. FormatError if one is lost."""
    file, found = opened_index(path)
    file.close()
    with closing(Store(path)) as store:
        for shard, (reason, _) in store.lost().items():
            raise FormatError(shard, reason)
    yield from (place for place in shard_places(path, found["shards"]) if isinstance(place, Path))
    yield path


def _send(file: Path, target: Url, overwrite: bool) -> bool:
    """Send a store's file; return False if it is there already."""
    with file.open("rb") as opened:
        head = opened.read(BEGIN)
        place, length, _ = index_place(head, None)
        opened.seek(place)
        index = opened.read(length)
    there = _there(target)
    if there == head and _ends_with(target, place, index):
        return False
    if there is not None and there != head and not overwrite:
        raise FileExistsError(f"{target} already exists: --overwrite (in Python overwrite=True) replaces it")
    _verify(file)
    size = place + length
    say(f"sending {shown(file)}, {size / 1e6:,.1f} MB")
    # sending is often slower than reading
    until = time.monotonic() + transport.DEADLINE + 2 * SLOWER * size / transport.SLOWEST
    repeated(target, lambda system, path: system.put_file(str(file), path), SLOWER * size, until)
    if _there(target) != head or not _ends_with(target, place, index):
        raise OSError(f"{target}: isn't what was sent: push it again")
    return True


def _verify(file: Path) -> None:
    """Raise FormatError unless all events of a file match their checksums."""
    with closing(Store(file)) as store:
        for name in () if store.holds_no_records else bar(store.names, f"verifying {file.name}", unit="rec"):
            if fault := store.fault(name):
                raise FormatError(f"{file}:{name}", fault)


def _there(target: Url) -> bytes | None:
    """Return the first bytes of a remote file, or all if it is shorter; None if there is none."""

    def beginning(system: Any, path: str) -> bytes | None:
        if not system.exists(path):
            return None
        found: bytes = system.cat_file(path, start=0, end=BEGIN)
        return found

    return repeated(target, beginning)


def _ends_with(target: Url, place: int, index: bytes) -> bool:
    """Return whether a remote file has this index, and ends after it."""

    def size(system: Any, path: str) -> int:
        system.invalidate_cache()
        found: int = system.info(path)["size"]
        return found

    end = place + len(index)
    return repeated(target, size) == end and np.array_equal(
        np.frombuffer(read_range(target, place, end), np.uint8), np.frombuffer(index, np.uint8)
    )


def _content(target: Url) -> bytes | None:
    """Return the content of a remote file; None if there is none."""

    def content(system: Any, path: str) -> bytes | None:
        if not system.exists(path):
            return None
        found: bytes = system.cat_file(path)
        return found

    return repeated(target, content)
