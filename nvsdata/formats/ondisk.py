"""The bytes of a file, read rather than mapped.

A mapped file that another process cuts short ends this one, and each map keeps a descriptor for as long as anything
refers to it. So a recording keeps a path, opens it for each read, and closes it: reading costs no more than mapping.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO

import numpy as np

from nvsdata.errors import FormatError


class OnDisk:
    """A file as it was when it was opened.

    Reading raises FormatError if it was cut short, written to or replaced since: what was learned of it no longer
    holds.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._stamp = _stamp(os.stat(path))

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._stamp[0]

    @contextmanager
    def opened(self) -> Iterator[FileIO]:
        """The file, open while the block runs."""
        with open(self.path, "rb", buffering=0) as file:
            self._check(_stamp(os.fstat(file.fileno())))
            yield file

    def check(self) -> None:
        """FormatError if the file isn't as it was."""
        self._check(_stamp(os.stat(self.path)))

    def _check(self, now: tuple[int, ...]) -> None:
        if now[0] < self.size:
            raise FormatError(self.path, now[0], f"truncated: it had {self.size} bytes when it was opened")
        if now != self._stamp:
            raise FormatError(self.path, None, "was changed after it was opened: open it again")

    def fill(self, file: FileIO, at: int, target: np.ndarray) -> None:
        """Read the bytes from `at` on into `target`, a contiguous array, as many as it has."""
        view = target.reshape(-1).view(np.uint8).data
        file.seek(at)
        done = 0
        while done < len(view):
            # the system hands out 2 GiB at most at a time
            count = file.readinto(view[done:])
            if not count:
                raise FormatError(self.path, at + done, "truncated while it was read")
            done += count


def _stamp(status: os.stat_result) -> tuple[int, ...]:
    return status.st_size, status.st_mtime_ns, status.st_ino, status.st_dev
