"""Copies of remote stores on the local disk: resumable, and checked."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from nvsdata.common.errors import FormatError, shown
from nvsdata.common.files import append_own, creating, named, put, remove_link, write_all
from nvsdata.common.progress import bar
from nvsdata.common.terminal import say
from nvsdata.datasets.store.file import AGAIN
from nvsdata.datasets.store.index import BEGIN, head_check, index_place
from nvsdata.datasets.store.opened import opened_index, remote_head
from nvsdata.datasets.store.reader import Store
from nvsdata.remote.transport import read_range
from nvsdata.remote.url import Url

CHUNK = 16 << 20  # bytes of a request


def fetch(url: str, out: str | os.PathLike[str], *, overwrite: bool = False) -> list[Path]:
    """Copy a remote store into a folder; of joined shards, the index file and all shards.

    A file appears when it is complete and all of its checksums are right. What has arrived earlier is kept: files, and
    the part of a file in `.NAME.part`. Bytes that fail their checksum are requested again.

    Args:
        url: URL of the store, or of the index file of joined shards.
        out: the folder, made if needed.
        overwrite: whether to replace existing files of other stores.

    Returns:
        Paths of the copied files; the last one is that of the store.

    Raises:
        FileExistsError: a file with the name of another store exists, unless `overwrite`.
        FormatError: a file isn't a store, isn't the shard that was joined, or is damaged.
        OSError: the server or the disk fails; repeating the call continues.
        OutputInUse: another process writes a file.

    Example:
        >>> fetch("hf://datasets/user/name/n-mnist.nvs", "data")  # doctest: +SKIP
    """
    source, folder = Url(url), Path(out).expanduser()
    file, found = opened_index(source)
    file.close()
    folder.mkdir(parents=True, exist_ok=True)
    copied = []
    for shard in found["shards"]:
        place = source.sibling(shard.file)
        head = remote_head(place)
        if head_check(head) != shard.head:
            raise FormatError(str(place), "isn't the shard that was joined: push all shards and their index again")
        copied.append(_copied(place, folder / shard.file, head, overwrite))
    # the index appears last: without it, the shards aren't a store
    copied.append(_copied(source, folder / source.name, remote_head(source), overwrite))
    return copied


def _copied(source: Url, target: Path, head: bytes, overwrite: bool) -> Path:
    """Copy a file that begins with `head`, unless it is there; return its path."""
    place, length, _ = index_place(head, None)
    if target.is_file() and target.stat().st_size == place + length and _begins_with(target, head):
        say(f"{shown(target)} is there")
        return target
    with creating(target, overwrite=overwrite), named(target):
        part = target.with_name(f".{target.name}.part")
        remove_link(part)
        if not _begins_with(part, head):
            # the checksum of the head is known to be right
            put(part, head)
        try:
            _append_rest(source, part, place + length)
            _repair(source, part)
        except BaseException:
            if part.exists():
                done = f"{part.stat().st_size:,} of {place + length:,} bytes"
                say(f"{done} are in {shown(part)}: the same command resumes")
            raise
        os.replace(part, target)
    return target


def _begins_with(path: Path, head: bytes) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(BEGIN) == head
    except OSError:
        return False


def _append_rest(source: Url, part: Path, size: int) -> None:
    """Request the bytes that are missing at the end of a part."""
    if (have := part.stat().st_size) > size:
        os.truncate(part, size)
    with (
        append_own(part) as file,
        bar(None, source.name, total=size, initial=have, unit="B", unit_scale=True) as progress,
    ):
        for begin in range(have, size, CHUNK):
            raw = read_range(source, begin, min(begin + CHUNK, size))
            write_all(file.fileno(), raw)
            progress.update(len(raw))
        os.fsync(file.fileno())


def _repair(source: Url, part: Path) -> None:
    """Request bytes again that fail their checksum. FormatError if they still do after several requests."""
    for left in range(AGAIN, -1, -1):
        damaged = list(_damaged(part))
        if damaged and not left:
            begin, _, reason = damaged[0]
            raise FormatError(str(source), reason, offset=begin)
        for begin, end, _ in damaged:
            raw = read_range(source, begin, end)
            with part.open("r+b", buffering=0) as file:
                file.seek(begin)
                write_all(file.fileno(), raw)
                os.fsync(file.fileno())
        if not damaged:
            return


def _damaged(part: Path) -> Iterator[tuple[int, int, str]]:
    """Yield first byte and end of each range that fails its checksum, and the reason."""
    try:
        store = Store(part)
    except FormatError as error:
        with part.open("rb") as file:
            place, length, _ = index_place(file.read(BEGIN), None)
        yield place, place + length, error.reason
        return
    if store.holds_no_records:
        return
    with closing(store):
        for number, name in enumerate(bar(store.names, "verifying", unit="rec")):
            if reason := store.fault(name):
                yield *store.extent(number), f"{shown(name)}: {reason}"
