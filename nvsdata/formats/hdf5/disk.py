"""New HDF5 files whose writing errors are raised.

The HDF5 library notices a full disk too late: h5py only prints errors that occur while a file is closed, and the
process may crash. So the library writes through `_Disk`, which never fails: after an error of the disk, `_Disk` keeps
the rest of the library's data in memory, and `check` raises the error. For the same reason, signals don't interrupt
`_Disk`.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from nvsdata.common.signals import never_within

# the newer layout has checksums, and strings of fixed length need no heap: the library hangs on some damaged heaps
_LAYOUT: dict[str, Any] = {"libver": ("v110", "latest")}


@contextmanager
def created(path: Path) -> Iterator[tuple[Any, _Disk]]:
    """Create an HDF5 file that replaces any file at `path`; yield it and its `_Disk`, whose `check` raises errors.

    At the end of the block the file is closed; it is complete if no error is raised. The first OSError of writing is
    raised.
    """
    with _Disk(path) as disk:
        with never_within(_CALLED_BY_LIBRARY), h5py.File(disk, "w", **_LAYOUT) as file:
            yield file, disk
        disk.check()


class _Disk(io.RawIOBase):
    """A file that the HDF5 library writes and reads at any offset.

    For the library, each call succeeds and transfers all bytes. After an error, writes are kept in memory, and `check`
    raises the error.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("w+b", buffering=0)
        self._error: OSError | None = None
        self._kept: list[tuple[int, bytes]] = []  # offset and content of writes after the error
        self._at = self._end = 0

    def check(self) -> None:
        """Raise the first error of the disk, if there was one."""
        if self._error is not None:
            raise self._error

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        place = self._at
        if self._error is None:
            try:
                self._file.seek(place)
                done = 0
                while done < len(view):
                    done += self._file.write(view[done:]) or 0
            except OSError as error:
                self._error = error
        if self._error is not None:
            self._kept.append((place, bytes(view)))
        self._at = place + len(view)
        self._end = max(self._end, self._at)
        return len(view)

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        size = max(min(len(view), self._end - self._at), 0)
        self._file.seek(self._at)
        found = self._file.readinto(view[:size]) or 0
        view[found:size] = bytes(size - found)
        for place, content in self._kept:
            lo, hi = max(place, self._at), min(place + len(content), self._at + size)
            if lo < hi:
                view[lo - self._at : hi - self._at] = content[lo - place : hi - place]
        self._at += size
        return size

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._end}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def truncate(self, size: int | None = None) -> int:
        size = self._at if size is None else size
        if self._error is None:
            try:
                self._file.truncate(size)
            except OSError as error:
                self._error = error
        self._end = size
        return size

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def close(self) -> None:
        if not self.closed:
            try:
                self._file.close()
            except OSError as error:
                self._error = self._error or error
        super().close()


_CALLED_BY_LIBRARY = {getattr(_Disk, name).__code__ for name in ("write", "readinto", "seek", "tell", "truncate")}
