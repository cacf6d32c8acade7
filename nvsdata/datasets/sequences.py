"""Batches of consecutive windows, for networks that carry their state from one batch to the next."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from heapq import heapreplace
from itertools import pairwise
from operator import index
from typing import NamedTuple

import numpy as np

from nvsdata.common.validation import whole
from nvsdata.datasets.facts import Sample
from nvsdata.datasets.order import random_below, shuffled
from nvsdata.datasets.resumable import ResumableBatches
from nvsdata.datasets.seeded import SequenceKey


class _Sequences(NamedTuple):
    """Sequences one after the other: int64 [N] each.

    Attributes:
        begins: Index of the first window of each sequence.
        windows: Number of windows of each sequence.
        steps: Number of steps, with padding.
    """

    begins: np.ndarray
    windows: np.ndarray
    steps: np.ndarray


class SequenceBatches(ResumableBatches[SequenceKey]):
    """A `batch_sampler` of consecutive windows, for recurrent and spiking networks, with `SeededDataset`.

    Row b of a batch is the window after row b of the batch before. If the recording has ended, row b is the first
    window of another recording, and `first[b]` is True: the network must reset the state of this row. Each window of
    the dataset is in one batch per epoch. The recordings are distributed so that all rows take about the same number of
    steps. Rows that end before the longest one repeat their last window, with `valid[b]` False: leave these rows out of
    the loss and the metrics. In a step, all rows of a process can be padding.

    With `length`, the rows are random sequences of `length` windows, and all rows begin a sequence in the same step. A
    recording of n windows is cut into n // length sequences. The first one begins at a random window, from 0 to
    n % length, and the windows that are left over aren't in this epoch. A shorter recording is one sequence, whose end
    is padded as above.

    A batch depends on the arguments, its epoch and its step only. So a run can continue at any step, if the state of
    the network was saved, too. All epochs have the same number of steps. Memory is proportional to the number of
    sequences, not of windows.

    Args:
        windows: Number of windows of each recording, in the order of the dataset; `windows_per_recording()` of a
            dataset of windows returns them.
        batch_size: Rows of a batch, of all processes together; at most the number of sequences.
        length: Windows per sequence (default None: all windows of a recording).
        first: First epoch (default 0).
        last: The epoch after the last one (default 1).
        start: Number of steps of the first epoch to leave out, because they are done (default 0).
        shuffle: True for a random order of the sequences, and random beginnings, in each epoch (default False).
        seed: Seed of the random orders (default 0).
        part: (rank, count) of this process among `count` processes that divide the rows, in order of rank (default
            (0, 1)). All have the same number of steps.

    Raises:
        ValueError: A number is out of range, a recording has no windows, or there are more rows than sequences.
        TypeError: A number isn't an integer.

    Example:
        >>> from nvsdata import SequenceBatches
        >>> for batch in SequenceBatches([3, 2, 2], 2):
        ...     print([(key.window, key.window == key.start, key.valid) for key in batch])
        [(0, True, True), (3, True, True)]
        [(1, False, True), (4, False, True)]
        [(2, False, True), (5, True, True)]
        [(2, False, False), (6, False, True)]
    """

    def __init__(
        self,
        windows: Sequence[int] | np.ndarray,
        batch_size: int,
        *,
        length: int | None = None,
        first: int = 0,
        last: int = 1,
        start: int = 0,
        shuffle: bool = False,
        seed: int = 0,
        part: tuple[int, int] = (0, 1),
    ) -> None:
        super().__init__(batch_size, first, last, start, seed, part)
        self.windows = np.array(list(map(index, windows)), np.int64)
        self.length, self.shuffle = None if length is None else index(length), shuffle
        if self.length is not None:
            whole("length", self.length, 1)
        if self.windows.min(initial=1) < 1:
            raise ValueError(f"recording {int(self.windows.argmin())} has {self.windows.min()} windows")
        self._check_parts()
        steps = self._sequences(0).steps
        if self.batch_size > steps.size:
            raise ValueError(f"batch_size must be at most {steps.size}, the number of sequences, not {batch_size}")
        # of any order, because equal sequences can replace each other
        self._steps = max(int(steps[row].sum()) for row in _distributed(steps, self.batch_size))
        self._check_start(self._steps)

    @property
    def steps(self) -> int:
        """Steps per epoch: those of the longest row."""
        return self._steps

    def _sequences(self, epoch: int) -> _Sequences:
        begins = np.cumsum(self.windows) - self.windows
        if self.length is None:
            return _Sequences(begins, self.windows, self.windows)
        number = np.maximum(self.windows // self.length, 1)
        if self.shuffle:
            left = np.maximum(self.windows - number * self.length, 0)
            begins = begins + random_below(left + 1, self.seed, epoch)
        inside = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
        windows = np.repeat(np.minimum(self.windows, self.length), number)
        return _Sequences(np.repeat(begins, number) + inside * self.length, windows, np.full_like(windows, self.length))

    @lru_cache(maxsize=2)  # noqa: B019  the instance lives as long as its run
    def _rows(self, epoch: int) -> list[tuple[_Sequences, np.ndarray]]:
        """Return the sequences of this process's rows, one after the other, and the step at which each has ended."""
        sequences = self._sequences(epoch)
        order = np.arange(sequences.steps.size)
        if self.shuffle:
            order = shuffled(order, order.size, self.seed, epoch)
        rows = _distributed(sequences.steps[order], self.batch_size)
        each = self.batch_size // self.count
        mine = [order[row] for row in rows[self.rank * each : (self.rank + 1) * each]]
        chosen = [_Sequences(*(column[row] for column in sequences)) for row in mine]
        return [(row, np.cumsum(row.steps)) for row in chosen]

    def _batches(self, epoch: int, steps: range) -> list[list[SequenceKey]]:
        """Return this process's keys of several steps."""
        at = np.arange(steps.start, steps.stop)
        rows = [_keys(epoch, *row, at) for row in self._rows(epoch)]
        return list(map(list, zip(*rows, strict=True)))


def _keys(epoch: int, row: _Sequences, ends: np.ndarray, steps: np.ndarray) -> list[SequenceKey]:
    """Return the keys of a row at some steps."""
    # after the end, the last window of the last sequence is repeated
    which = np.minimum(np.searchsorted(ends, steps, "right"), ends.size - 1)
    inside = steps - (ends - row.steps)[which]
    starts, windows = row.begins[which], row.windows[which]
    indices = starts + np.minimum(inside, windows - 1)
    columns = (column.tolist() for column in (indices, starts, inside < windows))
    return [SequenceKey(epoch, *key) for key in zip(*columns, strict=True)]


def _distributed(steps: np.ndarray, rows: int) -> list[np.ndarray]:
    """Return the sequences of each row, in ascending order; the row with the first sequence comes first.

    The longest sequence that is left is given to the shortest row (Graham 1969), so the longest row has at most 4/3 of
    the best possible number of steps. The sums of the rows don't depend on the order of the sequences.
    """
    if (steps == steps[0]).all():
        return [np.arange(row, steps.size, rows) for row in range(rows)]
    sums = [(0, row) for row in range(rows)]  # a heap
    chosen: list[list[int]] = [[] for _ in range(rows)]
    for sequence in np.argsort(-steps, kind="stable").tolist():
        done, row = sums[0]
        chosen[row].append(sequence)
        heapreplace(sums, (done + int(steps[sequence]), row))
    return [np.array(row) for row in sorted(map(sorted, chosen))]


def window_counts(samples: Sequence[Sample]) -> np.ndarray:
    """Return the number of windows of each recording; see `Samples.windows_per_recording`."""
    start, stop = np.array([sample.window for sample in samples], np.int64).reshape(-1, 2).T
    # windows of events can begin in the same µs
    before = np.array([sample.events[0] if sample.events else 0 for sample in samples], np.int64)
    of_one = np.array([a.name == b.name and a.label == b.label for a, b in pairwise(samples)], np.bool_)
    distance = np.diff(start)
    of_one &= (distance > 0) | ((distance == 0) & (np.diff(before) > 0))
    near = start[1:] <= stop[:-1]
    # with step > duration, time lies between windows; then only the last window of a recording is shorter
    full = (stop - start)[:-1] == (stop - start).max(initial=0)
    values, counts = np.unique(distance[of_one], return_counts=True)
    if values.size:
        near |= full & (distance == values[counts.argmax()])
    ends = np.flatnonzero(~(of_one & near)) + 1
    found: np.ndarray = np.diff(ends, prepend=0, append=len(samples))
    # without samples, there is a single recording of 0 windows
    return found[found > 0]
