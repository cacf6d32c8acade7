"""Reading of the bytes of a file, which is opened for each read and not mapped into memory.

If another process truncates a mapped file, this process is killed. A mapping also keeps a descriptor open as long as an
array refers to it. Reading takes no longer than mapping.
"""

from __future__ import annotations

import os
from io import FileIO
from types import TracebackType

import numpy as np

from nvsdata.common.errors import FormatError


class OnDisk:
    """A file as it was at the creation of this object.

    Reading raises FormatError if the file was truncated, written or replaced since then, because an index of it may be
    wrong.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        status = os.stat(path)
        self._stamp, self._changed = _stamp(status), status.st_ctime_ns

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._stamp[0]

    @property
    def stamp(self) -> tuple[int, ...]:
        """Size in bytes, times of the last change of content and of metadata (ns since 1970), and inode.

        Programs can't set the time of the last change of metadata. So it shows that a file was replaced even if the new
        file has the same size and the same time of the last change of content.
        """
        return self._stamp[0], self._stamp[1], self._changed, self._stamp[2]

    def opened(self) -> OpenFile:
        """Return a context manager that opens the file while its block runs."""
        return OpenFile(self)

    def check(self, status: os.stat_result | None = None) -> None:
        """Raise FormatError if the file has changed."""
        now = _stamp(os.stat(self.path) if status is None else status)
        if now[0] < self.size:
            raise FormatError(self.path, f"truncated: it had {self.size} bytes when it was opened", offset=now[0])
        if now != self._stamp:
            raise FormatError(self.path, "was changed after it was opened: open it again")


class OpenFile:
    """A file that is open while a block runs; opening only a descriptor takes half the time of a Python file object."""

    __slots__ = ("descriptor", "file")

    def __init__(self, file: OnDisk) -> None:
        self.file = file

    def __enter__(self) -> OpenFile:
        self.descriptor = os.open(self.file.path, _READ)
        try:
            self.file.check(os.fstat(self.descriptor))
        except BaseException:
            os.close(self.descriptor)
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        try:
            if kind is None:
                # another process may have written to it
                self.file.check(os.fstat(self.descriptor))
        finally:
            os.close(self.descriptor)

    def fill(self, at: int, target: np.ndarray) -> None:
        """Fill a contiguous array with the bytes of the file from `at` on."""
        read_into(self.descriptor, self.file.path, at, target)


def read_into(descriptor: int, path: str, at: int, target: np.ndarray) -> None:
    """Fill a contiguous array with the bytes of an open file from `at` on.

    The file's position, which forked workers share, doesn't move. FormatError, which names `path`, if the file is too
    short.
    """
    wanted = target.nbytes
    done = _read_at(descriptor, target, at) if wanted else 0
    while done < wanted:
        # one call reads at most 2 GiB
        count = _read_at(descriptor, target.reshape(-1).view(np.uint8)[done:], at + done)
        if not count:
            raise FormatError(path, "truncated while it was read", offset=at + done)
        done += count


_READ = os.O_RDONLY | getattr(os, "O_BINARY", 0)

if hasattr(os, "preadv"):

    def _read_at(descriptor: int, target: np.ndarray, at: int) -> int:
        return os.preadv(descriptor, (target.data,), at)

else:

    def _read_at(descriptor: int, target: np.ndarray, at: int) -> int:
        file = FileIO(descriptor, closefd=False)
        file.seek(at)
        return file.readinto(target.data) or 0


def _stamp(status: os.stat_result) -> tuple[int, ...]:
    return status.st_size, status.st_mtime_ns, status.st_ino, status.st_dev
