"""A cache of blocks of remote files on the local disk, which processes share.

A block is a file: its bytes, then the CRC-32C of each `PIECE` of them, then `TAIL`. A piece is verified when a process
first reads from it. Blocks that were used least recently are removed when the cache has grown too large.
"""

from __future__ import annotations

import os
import re
import struct
import time
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from pathlib import Path

import numpy as np

from nvsdata.common.errors import FormatError, message_of, shown
from nvsdata.common.files import atomic, put, remove_link, sweep
from nvsdata.common.locks import OutputInUse, locked
from nvsdata.formats.ondisk import read_into
from nvsdata.kernels.decode.blocks import crc32c

BLOCK = 8 << 20  # bytes that are requested at a time
PIECE = 1 << 18  # bytes that are verified at a time
TAIL = struct.Struct("<8sI")  # magic, and the checksum of the block's name and of the checksums of its pieces
MAGIC = b"NVSBLOCK"
SUFFIX = ".block"
FILES = re.compile(r"[0-9a-f]{32}/(\d+\.block|\.\d+\.block\.(.*\.part|lock))")  # paths below the folder of a cache
FOLDER, SIZE = "NVSDATA_BLOCKS", "NVSDATA_BLOCKS_GB"
USUAL_GB = 10.0
PARTS = 64  # the size of the cache is checked when a process has written this part of it
CACHE_TAG = "CACHEDIR.TAG"
TAG = b"Signature: 8a477f597d28d172789f06886806bc55\n# blocks of remote files, by nvsdata; they can be read again\n"
WAIT = 0.01  # s between looks at a block that another process reads


class Block:
    """A block that is open: in a file of the cache or, if the disk is full, in memory."""

    __slots__ = ("_checks", "_content", "_file", "_length", "_verified")

    def __init__(self, content: FileIO | np.ndarray, length: int, checks: np.ndarray) -> None:
        self._file = content if isinstance(content, FileIO) else None
        self._content = None if isinstance(content, FileIO) else content
        self._length, self._checks = length, checks.tolist()
        self._verified = bytearray(len(checks))

    def fill(self, at: int, target: np.ndarray) -> bool:
        """Fill uint8 `target` with the bytes from `at` on; return False if they fail their checksum."""
        end = at + target.size
        for piece in range(at // PIECE, -(-end // PIECE)):
            if not self._verified[piece] and not self._verify(piece):
                return False
        return self._read(at, target)

    def _verify(self, piece: int) -> bool:
        begin = piece * PIECE
        own = np.empty(min(PIECE, self._length - begin), np.uint8)
        self._verified[piece] = self._read(begin, own) and crc32c(own) == self._checks[piece]
        return bool(self._verified[piece])

    def _read(self, at: int, target: np.ndarray) -> bool:
        if self._content is not None:
            target[:] = self._content[at : at + target.size]
            return True
        assert self._file is not None
        return _filled(self._file, at, target)

    def is_same_file(self, path: Path) -> bool:
        """Return whether this block is the file at `path`."""
        with suppress(OSError):
            return self._file is not None and os.path.samestat(os.fstat(self._file.fileno()), os.stat(path))
        return False


class BlockCache:
    """Blocks on the local disk.

    Args:
        folder: the folder, made if needed.
        most: bytes of all blocks.
    """

    def __init__(self, folder: Path, most: int) -> None:
        self.folder, self.most = folder, most
        self.is_full = False  # if it can't be written to: blocks are in memory, and each process reads its own
        self._written = most  # the first block that is written causes a check of the size

    def path(self, key: str, number: int) -> Path:
        """Return the path of a block of the file `key`."""
        return self.folder / key / f"{number}{SUFFIX}"

    def open(self, key: str, number: int, length: int) -> Block | None:
        """Return a block of `length` bytes; None if it isn't in the cache. A damaged one is removed."""
        path, pieces = self.path(key, number), -(-length // PIECE)
        try:
            file = FileIO(path, opener=_open_unfollowed)
            # the time of the last use
            os.utime(path)
        except FileNotFoundError:
            return None
        except OSError as error:
            if path.is_symlink():
                path.unlink(missing_ok=True)
            else:
                self.give_up(error)
            return None
        end = np.empty(4 * pieces + TAIL.size, np.uint8)
        checks = end[: 4 * pieces].view(np.uint32)
        if _filled(file, length, end) and end[4 * pieces :].tobytes() == _tail(key, number, checks):
            return Block(file, length, checks)
        self.remove(key, number, Block(file, length, checks))
        return None

    def add(self, key: str, number: int, content: np.ndarray) -> Block:
        """Write a block, uint8, and return it. If the disk is full, warn once, and return it in memory."""
        checks = np.array([crc32c(content[at : at + PIECE]) for at in range(0, content.size, PIECE)], np.uint32)
        if not self.is_full:
            try:
                self._write(self.path(key, number), content, checks.tobytes() + _tail(key, number, checks))
                self._written += content.size
                if self._written > self.most // PARTS:
                    self._written = 0
                    self._trim()
                if (found := self.open(key, number, content.size)) is not None:
                    return found
            except FileNotFoundError:
                pass  # another process empties the cache
            except OSError as error:
                self.give_up(error)
        return Block(content, content.size, checks)

    def give_up(self, error: OSError) -> None:
        """Warn, the first time, that the cache can't be written to, and no longer try."""
        if not self.is_full:
            self.is_full = True
            message = f"{self.folder} can't be written to, so each process reads blocks of remote files again"
            warnings.warn(f"{shown(message)}: {message_of(error)}", stacklevel=2)

    def _write(self, path: Path, content: np.ndarray, end: bytes) -> None:
        for last in (False, True):
            try:
                self.make_folder(path.parent)
                # not flushed to the disk: after a power failure, the checksums show what is missing
                with atomic(path, flush=False) as temporary, temporary.open("wb", buffering=0) as file:
                    for part in (content.data, end):
                        view = memoryview(part)
                        while view:
                            view = view[file.write(view) :]
                return
            except FileNotFoundError:
                # another process may have emptied the cache meanwhile
                if last:
                    raise

    def make_folder(self, folder: Path) -> None:
        """Make the folder of a file's blocks, and mark the cache for backup programs."""
        if not folder.is_dir():
            remove_link(folder)
            folder.mkdir(parents=True, exist_ok=True)
            sweep(self.folder)
            if not (self.folder / CACHE_TAG).exists():
                put(self.folder / CACHE_TAG, TAG)

    def remove(self, key: str, number: int, block: Block) -> None:
        """Remove a damaged block, unless another process has replaced it already."""
        if block.is_same_file(path := self.path(key, number)):
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                self.give_up(error)

    def _trim(self) -> None:
        """Remove the blocks that were used least recently, if all together are too large."""
        found = []
        for path in self.folder.glob(f"*/*{SUFFIX}"):
            with suppress(OSError):
                status = path.stat()
                found.append((status.st_mtime_ns, status.st_size, path))
        size = sum(size for _, size, _ in found)
        if size <= self.most:
            return
        for _, own, path in sorted(found):
            # some space is left for the blocks that processes write before they check again
            if size <= self.most - self.most // 8:
                return
            with suppress(OSError):
                path.unlink()
                size -= own
                path.parent.rmdir()

    @contextmanager
    def claimed(self, key: str, numbers: range, until: float) -> Iterator[list[int]]:
        """Keep other processes from reading blocks from the server while the block of code runs.

        Yields the blocks to read: the first of `numbers`, and those after it, up to the first that is there or that
        another process reads. If that is so of the first one, it yields [], after a pause of `WAIT` if time is left.
        """
        with ExitStack() as locks:
            mine: list[int] = []
            for number in numbers:
                path = self.path(key, number)
                if path.exists():
                    break
                try:
                    self.make_folder(path.parent)
                    locks.enter_context(locked(path))
                except (OutputInUse, FileNotFoundError):
                    if not mine and time.monotonic() < until:
                        time.sleep(WAIT)
                    break
                # another process may have finished it before the lock was taken
                if path.exists():
                    break
                mine.append(number)
            yield mine


def _open_unfollowed(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0))


def _filled(file: FileIO, at: int, target: np.ndarray) -> bool:
    """Fill `target` with the bytes of a file from `at` on; return False if there are fewer."""
    try:
        read_into(file.fileno(), "", at, target)
    except FormatError:
        return False
    return True


def _tail(key: str, number: int, checks: np.ndarray) -> bytes:
    """Return the last bytes of a block, which show that it is the one of this name."""
    named = np.frombuffer(f"{key}/{number}".encode() + checks.tobytes(), np.uint8)
    return TAIL.pack(MAGIC, crc32c(named))


def block_cache() -> BlockCache:
    """Return the cache in the folder $NVSDATA_BLOCKS, of at most $NVSDATA_BLOCKS_GB.

    By default, the folder is `blocks` in nvsdata's cache folder, and the size 10 GB. ValueError if the size isn't a
    positive number.
    """
    given = os.environ.get(SIZE, "")
    try:
        size = float(given or USUAL_GB)
    except ValueError:
        size = 0.0
    if not 0 < size < 1e9:
        raise ValueError(f"{SIZE} must be a positive number of GB, not {given!r}")
    if chosen := os.environ.get(FOLDER):
        return BlockCache(Path(chosen).expanduser(), int(size * 1e9))
    # imported here, because importing pooch takes a quarter of a second
    import pooch

    return BlockCache(Path(pooch.os_cache("nvsdata")) / "blocks", int(size * 1e9))
