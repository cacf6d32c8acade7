"""Sets of numbers that loops fill and work off: each number once, in the order in which it came."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from nvsdata.kernels.compiling import njit


class Marks(NamedTuple):
    """Some of the numbers below `marked.size`: the first `count[0]` of `numbers`, those that are `marked`."""

    numbers: np.ndarray
    marked: np.ndarray
    count: np.ndarray

    @classmethod
    def none(cls, size: int) -> Self:
        """No number yet, of those below `size`."""
        return cls(np.empty(size, np.int64), np.zeros(size, np.bool_), np.zeros(1, np.int64))


@njit(inline="always")
def mark(marks, number):
    """Add a number."""
    if not marks.marked[number]:
        marks.marked[number] = True
        marks.numbers[marks.count[0]] = number
        marks.count[0] += 1


@njit
def clear(marks):
    """Remove all numbers. O(their number)."""
    for n in range(marks.count[0]):
        marks.marked[marks.numbers[n]] = False
    marks.count[0] = 0
