"""Opening of a packed store's file, local or remote: its head and its index."""

from __future__ import annotations

import errno
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.datasets.store.file import AGAIN, LocalFile, StoreFile, filled
from nvsdata.datasets.store.index import BEGIN, index_place, unpacked_index
from nvsdata.remote.file import RemoteFile
from nvsdata.remote.transport import check_ranges, read_range
from nvsdata.remote.url import Url

HDF5 = b"\x89HDF"


def opened_index(path: Path | Url) -> tuple[StoreFile, dict[str, Any]]:
    """Return a store's file, opened, and the contents of its index, as `unpacked_index` does.

    Raises:
        FormatError: the file isn't a store of this version, is cut short, or its index is damaged.
        OSError: a remote file can't be read.
    """
    try:
        file, place, length, check = _opened(path)
    except ValueError as error:
        raise error if isinstance(error, FormatError) else FormatError(str(path), str(error)) from None
    try:
        raw = np.empty(length, np.uint8)
        if not filled(file, place, raw, check):
            raise ValueError("its index fails its checksum: pack it again")
        found = unpacked_index(raw)
        if not found["shards"] and found["place"][-1] != place:
            raise ValueError("its index contradicts itself: pack it again")
    except ValueError as error:
        file.close()
        raise error if isinstance(error, FormatError) else FormatError(str(path), str(error)) from None
    return file, found


def _opened(path: Path | Url) -> tuple[StoreFile, int, int, int]:
    """Return a store's file, and place, size and checksum of its index. ValueError if its head isn't one."""
    if isinstance(path, Url):
        head = remote_head(path)
        place, length, check = index_place(head, None)
        return RemoteFile(path, place + length, head), place, length, check
    file = LocalFile(path)
    try:
        return file, *index_place(file.read(BEGIN) or b"", file.size)
    except ValueError:
        file.close()
        raise


def remote_head(url: Url) -> bytes:
    """Return the first `BEGIN` bytes of a remote store, whose checksum is right.

    Raises:
        ValueError: the file isn't a store of this version, or is damaged.
        OSError: the file can't be read.
    """
    for _ in range(AGAIN):
        # the bytes may change on their way
        with suppress(ValueError):
            index_place(head := _first_bytes(url), None)
            return head
    index_place(head := _first_bytes(url), None)
    return head


def _first_bytes(url: Url) -> bytes:
    try:
        check_ranges(url)
        head = read_range(url, 0, BEGIN)
    except (FileNotFoundError, IsADirectoryError) as error:
        # object stores have no folders
        reason = "no such file; of a folder of recordings, pack a store (`nvsdata pack`), and push it (`nvsdata push`)"
        raise FileNotFoundError(error.errno or errno.ENOENT, reason, str(url)) from None
    if head.startswith(HDF5):
        raise ValueError("is an HDF5 file: stores of the second layout can't be read by URL, pack it again")
    if head.lstrip()[:1] == b"<":
        raise ValueError("the server sent a page, not a store: a folder of recordings must be packed (`nvsdata pack`)")
    return head
