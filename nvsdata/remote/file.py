"""Remote files, read through the cache of blocks."""

from __future__ import annotations

import errno
import hashlib
import os
import sys
import time
from contextlib import suppress
from threading import Lock, Thread
from typing import NamedTuple

import numpy as np

from nvsdata.remote import transport
from nvsdata.remote.blocks import BLOCK, Block, BlockCache, block_cache
from nvsdata.remote.transport import read_range
from nvsdata.remote.url import Url

DAMAGES = 3  # blocks that are read again in one read, because they are damaged on the local disk
OPEN = 128  # blocks that a process has open; an order by blocks mixes up to as many
IN_MEMORY = 4  # blocks that a process keeps in memory if the disk is full
TOGETHER = 2  # neighboring blocks in one request; with more, memory of the answer costs more than the request
LARGE = 31 << 20  # bytes; glibc's limit is 32 MiB
AHEAD = 4  # blocks that are read ahead


class _Process(NamedTuple):
    """State of this process: the cache, and the blocks that are open, by file and number."""

    cache: BlockCache
    open: dict[tuple[str, int], Block]
    lock: Lock


_process: _Process | None = None


def _state() -> _Process:
    global _process
    if _process is None:
        _process = _Process(block_cache(), {}, Lock())
        # freeing as much makes glibc keep memory of this size, which it would return to the system after each block;
        # getting it back costs more than the transfer
        bytes(LARGE)
    return _process


def _forget() -> None:
    """Start again in a forked process, because a thread of the parent may have had the lock."""
    global _process
    _process = None
    if (asyn := sys.modules.get("fsspec.asyn")) is not None:
        # its thread isn't there either; newer versions do this themselves
        asyn.reset_lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


class RemoteFile:
    """A remote file, read in blocks that are kept on the local disk.

    If blocks are read one after the other, the next ones are read ahead in another thread.

    Args:
        url: the file.
        size: bytes of the file.
        identity: bytes that differ if the content of the file differs, such as a checksum. Blocks are kept under URL,
            size and identity, so blocks of a changed file are never mixed with earlier ones.
    """

    def __init__(self, url: Url, size: int, identity: bytes) -> None:
        self.url, self.size, self.closed = url, size, False
        self._key = hashlib.sha256(f"{url}\n{size}\n{BLOCK}\n".encode() + identity).hexdigest()[:32]
        self._ahead: Thread | None = None

    def fill(self, place: int, target: np.ndarray) -> None:
        """Fill uint8 `target` with the bytes from a place on. OSError if the server doesn't send them in time."""
        done = damages = 0
        last = (place + target.size - 1) // BLOCK
        opened = _state().open
        while done < target.size:
            number, at = divmod(place + done, BLOCK)
            part = target[done : done + BLOCK - at]
            block = opened.get((self._key, number)) or self._opened(number, last)
            if block.fill(at, part):
                done += part.size
            elif damages < DAMAGES:
                damages += 1
                self._drop(number)
            else:
                folder = str(_state().cache.folder)
                raise OSError(errno.EIO, "blocks change on the disk after they were written", folder)

    def drop(self, place: int, size: int) -> bool:
        """Remove blocks whose bytes the caller found damaged; return True, because they can be read again."""
        for number in range(place // BLOCK, (place + size - 1) // BLOCK + 1):
            self._drop(number)
        return True

    def close(self) -> None:
        """Close the blocks of the file that are open."""
        self.closed = True
        state = _state()
        with state.lock:
            for key in [key for key in state.open if key[0] == self._key]:
                del state.open[key]

    def _length(self, number: int) -> int:
        return min(BLOCK, self.size - number * BLOCK)

    def _drop(self, number: int) -> None:
        state = _state()
        with state.lock:
            block = state.open.pop((self._key, number), None)
        block = block or state.cache.open(self._key, number, self._length(number))
        if block is not None:
            state.cache.remove(self._key, number, block)

    def _opened(self, number: int, last: int) -> Block:
        """Return a block, from the disk or the server, where missing blocks up to `last` are read with it."""
        cache, until = _state().cache, time.monotonic() + transport.DEADLINE
        while True:
            block = cache.open(self._key, number, self._length(number))
            if block is None:
                block = self._read(number, last, until)
            if block is not None:
                break
            if time.monotonic() > until:
                late = f"no success within {transport.DEADLINE:g} s: another process reads the same bytes"
                raise OSError(errno.ETIMEDOUT, late, str(self.url))
        self._keep(number, block)
        self._read_ahead(number)
        return block

    def _keep(self, number: int, block: Block) -> None:
        state = _state()
        with state.lock:
            state.open[self._key, number] = block
            most = IN_MEMORY if state.cache.is_full else OPEN
            for old in list(state.open)[:-most]:
                del state.open[old]

    def _read(self, number: int, last: int, until: float) -> Block | None:
        """Return a block from the server; None if another process has read it, or does so."""
        cache = _state().cache
        numbers = range(number, min(last, number + TOGETHER - 1) + 1)
        if not cache.is_full:
            try:
                with cache.claimed(self._key, numbers, until) as mine:
                    return self._fetch(mine, until) if mine else None
            except OSError as error:
                if error.errno not in (errno.ENOSPC, errno.EROFS, errno.EDQUOT) and not _is_of(error, cache):
                    raise
                cache.give_up(error)
        return self._fetch([number], until)

    def _fetch(self, numbers: list[int], until: float | None = None) -> Block:
        """Read neighboring blocks in one request, until a time of `time.monotonic`; return the first."""
        begin, end = numbers[0] * BLOCK, min((numbers[-1] + 1) * BLOCK, self.size)
        raw = np.frombuffer(read_range(self.url, begin, end, until), np.uint8)
        cache = _state().cache
        first, *_ = [
            cache.add(self._key, number, raw[at : at + BLOCK])
            for number, at in zip(numbers, range(0, raw.size, BLOCK), strict=True)
        ]
        return first

    def _read_ahead(self, number: int) -> None:
        """Read the blocks after this one in another thread, if the one before has been read, too."""
        cache = _state().cache
        last = min(number + AHEAD, (self.size - 1) // BLOCK)
        running = self._ahead is not None and self._ahead.is_alive()
        if running or cache.is_full or number >= last or not (number and cache.path(self._key, number - 1).exists()):
            return
        numbers = range(number + 1, last + 1)
        if not all(cache.path(self._key, n).exists() for n in numbers):
            self._ahead = Thread(target=self._read_missing, args=(numbers,), name="nvsdata-ahead", daemon=True)
            self._ahead.start()

    def _read_missing(self, numbers: range) -> None:
        # the read that needs a block reports the error
        with suppress(OSError, ValueError, ImportError):
            for number in numbers:
                some = range(number, min(number + TOGETHER, numbers.stop))
                # those that another process reads are left to it
                with _state().cache.claimed(self._key, some, 0) as mine:
                    if mine:
                        self._fetch(mine)


def _is_of(error: OSError, cache: BlockCache) -> bool:
    """Return whether an error is about a file of the cache."""
    return error.filename is not None and str(os.fspath(error.filename)).startswith(str(cache.folder))
