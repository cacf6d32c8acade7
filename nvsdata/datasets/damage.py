"""Damaged recordings in a dataset: replacement and count."""

from __future__ import annotations

import errno
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from nvsdata.common.errors import FormatError, shown
from nvsdata.common.memory import SharedArray

ERRORS = ("raise", "skip", "repair")
MAX_UNREADABLE = 100  # recordings in a row that may be unreadable: with more, the disk is damaged, not the files
REPLACED, REPAIRED = 1, 2
UNREADABLE = (FormatError, OSError)
OUT_OF = (errno.EMFILE, errno.ENFILE, errno.ENOMEM)  # the machine is out of files or memory: no recording is damaged


class Damage:
    """Damaged samples that all workers of a loader have found."""

    def __init__(self, count: int) -> None:
        self._shared = SharedArray(count, np.uint8)

    def found(self) -> dict[int, int]:
        """Return the index of each damaged sample, mapped to `REPLACED` or `REPAIRED`."""
        marks = self._shared.values
        (indices,) = marks.nonzero()
        return dict(zip(indices.tolist(), marks[indices].tolist(), strict=True))

    def mark(self, index: int, what: int, message: str) -> None:
        """Count a sample; warn about it the first time."""
        if not self._shared.values[index]:
            warnings.warn(shown(message), stacklevel=2)
        self._shared.values[index] = what

    def first_readable(self, index: int, make: Callable[[int], Any]) -> Any:
        """Return `make` of `index` or, if that can't be read, of the next readable index; the first follows the last.

        Raises the first error if `MAX_UNREADABLE` in a row can't be read, or none can.
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
