"""Files of stores: on the local disk, or remote."""

from __future__ import annotations

import os
import stat
from io import FileIO
from pathlib import Path
from typing import Protocol, Self

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.formats.ondisk import read_into
from nvsdata.kernels.decode.blocks import crc32c

AGAIN = 3  # times that bytes of a remote file are requested again, because they fail their checksum


class StoreFile(Protocol):
    """A file of a store that is open."""

    @property
    def closed(self) -> bool:
        """True if it was closed."""

    def fill(self, place: int, target: np.ndarray, /) -> None:
        """Fill uint8 `target` with the bytes from a place on."""

    def drop(self, place: int, size: int, /) -> bool:
        """Forget bytes that are damaged; return whether reading them again may return others."""

    def close(self) -> None:
        """Close the file."""


class LocalFile(FileIO):
    """A file on the local disk. Its position, which forked workers share, doesn't move.

    FormatError for a pipe or a device.
    """

    def __init__(self, path: Path) -> None:
        # a pipe could wait forever
        super().__init__(path, opener=lambda name, flags: os.open(name, flags | getattr(os, "O_NONBLOCK", 0)))
        self._name = str(path)
        if not stat.S_ISREG(os.fstat(self.fileno()).st_mode):
            self.close()
            raise FormatError(path, "is a pipe or a device, not a packed store")

    def __enter__(self) -> Self:
        return self

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return os.fstat(self.fileno()).st_size

    def fill(self, place: int, target: np.ndarray) -> None:
        """Fill uint8 `target` with the bytes from a place on. FormatError if there are fewer."""
        read_into(self.fileno(), self._name, place, target)

    def drop(self, place: int, size: int) -> bool:
        """Return False: the bytes stay as they are."""
        return False


def filled(file: StoreFile, place: int, target: np.ndarray, check: int) -> bool:
    """Fill uint8 `target` with the bytes of a file from a place on; return whether their checksum is `check`."""
    for _ in range(1 + AGAIN):
        file.fill(place, target)
        if crc32c(target) == check:
            return True
        if not file.drop(place, target.size):
            break
    return False
