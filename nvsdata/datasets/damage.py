"""Damaged recordings in a dataset: they are counted, and replaced with others."""

from __future__ import annotations

import errno
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from nvsdata.common.errors import FormatError, shown
from nvsdata.common.memory import SharedArray

ERRORS = ("raise", "skip", "repair")
MAX_UNREADABLE = 100  # recordings in a row; if all are unreadable, the disk is probably damaged, not the files
REPLACED, REPAIRED = 1, 2
UNREADABLE = (FormatError, OSError)
# no file descriptors, memory or connection left: no recording is damaged
OUT_OF = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ETIMEDOUT)


class Damage:
    """Record of the damaged samples among `count`, shared by all workers of a loader."""

    def __init__(self, count: int) -> None:
        self._shared = SharedArray(count, np.uint8)

    def found(self) -> dict[int, int]:
        """Return the index of each damaged sample, mapped to `REPLACED` or `REPAIRED`."""
        marks = self._shared.values
        (indices,) = marks.nonzero()
        return dict(zip(indices.tolist(), marks[indices].tolist(), strict=True))

    def mark(self, index: int, what: int, message: str) -> None:
        """Record a damaged sample as `what`: `REPLACED` or `REPAIRED`; the first time, warn with `message`."""
        if not self._shared.values[index]:
            warnings.warn(shown(message), stacklevel=2)
        self._shared.values[index] = what

    def first_readable(self, index: int, make: Callable[[int], Any]) -> Any:
        """Return `make(index)` or, if that recording can't be read, `make` of the next index whose recording can.

        After the last index comes the first. Raises the first error if `MAX_UNREADABLE` recordings in a row, or all
        of them, can't be read.
        """
        count = len(self._shared.values)
        first: Exception | None = None
        for step in range(min(MAX_UNREADABLE, count)):
            place = (index + step) % count
            try:
                return make(place)
            except UNREADABLE as error:
                if isinstance(error, OSError) and error.errno in OUT_OF:
                    raise
                first = first or error
                self.mark(place, REPLACED, f"{error}: the next recording that can be read takes its place")
        assert first is not None
        raise first
