"""Base class of `.dat` and AEDAT 1 and 2: records with times from a 32-bit counter of µs, which wraps."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns, Events
from nvsdata.formats.records import Blocks, PiecedFile
from nvsdata.kernels.decode.clock import (
    BACK_US,
    FELL,
    HIDDEN,
    JUMP,
    PEEK,
    PEEK_US,
    SILENT_US,
    SOON_US,
    UNKNOWN,
    WRAP_US,
    clock_at,
    extremes,
    first_time,
    kept_words,
    lasting,
    unwrap,
)


class ClockedFile(PiecedFile):
    """A file of records whose times wrap; a time is unwrapped by the record before it (see `kernels.decode.clock`).

    The index uses only the first records of each block. Three things make it wrong: an impossible step back (see
    `is_jump`), an event displaced by more than a block, and a block of more than 35 minutes that begins with a burst
    and seems to last less than `SOON_US`. Each of them raises a FormatError when the entire file is read.
    """

    block = 4096
    _keep: np.ndarray | None = None  # mask of the records that are read; None for all

    @abstractmethod
    def _times(self, raw: np.ndarray) -> np.ndarray:
        """Return the counter values of some records, uint32 [N]."""

    def _index(self) -> Blocks:
        if not self.records:
            return Blocks(*np.empty((2, 0), np.int64))
        whole, size = (self.records - 1) // self.block, self.record_size
        last = self._times(self.contents.read(self._byte(whole * self.block), self._byte(whole * self.block + 1)))
        raw = self.contents.samples(self._byte(0), self._byte(whole * self.block), self.block * size, PEEK * size)
        begins = self._times(raw.reshape(-1)).astype(np.int64).reshape(-1, PEEK)
        times = np.append(begins[:, 0], last)
        steps, first = _steps(times), _steps(begins).sum(1)
        for k in np.flatnonzero((steps <= 0) | (steps > SOON_US) | (first > PEEK_US)).tolist():
            block = self.contents.read(self._byte(k * self.block), self._byte((k + 1) * self.block + 1))
            steps[k], damaged = lasting(self._times(block))
            if damaged:
                raise self._jump()
        times[0] = first_time(times[0], 32)
        times[1:] = times[0] + np.cumsum(steps)
        return Blocks(times, times)

    def _state(self, record: int) -> np.ndarray:
        state: np.ndarray = clock_at(self.blocks.states[record // self.block] if record else UNKNOWN, record)
        return state

    def _check(self, state: np.ndarray) -> None:
        if state[JUMP] >= 0:
            raise self._jump()

    def _jump(self) -> FormatError:
        """Return the error for a file with impossible times (see `is_jump`)."""
        kept = self._kept()
        damaged = f"{kept.size - np.count_nonzero(kept)} of {kept.size} records are damaged"
        reason = f"a time that no camera writes: {damaged}, or the clock was set back; strict=False drops them"
        return FormatError(self.path, reason, offset=self._byte(int(np.argmin(kept))))

    def _kept(self) -> np.ndarray:
        """Return the mask of the records to keep of a damaged file: the most whose times a camera may have written."""
        times = [self._times(raw).astype(np.int64) for raw in super()._pieces(0, self.records)]
        kept: np.ndarray = kept_words(np.concatenate(times), 32, BACK_US, SILENT_US)
        return kept

    def _pieces(self, lo: int, hi: int) -> Iterator[np.ndarray]:
        for raw in super()._pieces(lo, hi):
            if self._keep is not None:
                records = raw.reshape(-1, self.record_size)
                raw = records[self._keep[lo : lo + len(records)]].reshape(-1)
                lo += len(records)
            yield raw

    def decode(self) -> Columns:
        columns, state = self._run(0, self.records)
        if self._drops(state):
            columns, state = self._run(0, self.records)
        self._rises = not state[FELL]
        if self.strict:
            self._check_index(state)
        return columns

    def _drops(self, state: np.ndarray) -> bool:
        """Set `_keep` and return True if the `state` after the last record shows damage that must be dropped."""
        if self.strict or state[JUMP] < 0 or self._keep is not None:
            return False
        self._keep = self._kept()
        self._repair("records of times that no camera writes, dropped", int(np.count_nonzero(~self._keep)))
        return True

    def _timed(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield bytes and times (µs, int64) of all records, piece by piece; damage is treated as in `decode`."""
        if not self.strict and self._keep is None:
            clock = clock_at(UNKNOWN, 0)
            for _ in self._clocked(clock):
                pass
            self._drops(clock)
        clock = clock_at(UNKNOWN, 0)
        for raw, t in self._clocked(clock):
            if self.strict:
                self._check(clock)
            yield raw, t

    def _clocked(self, clock: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield bytes and times (µs) of all records, piece by piece, and update the state `clock`."""
        for raw in self._pieces(0, self.records):
            t = self._times(raw).astype(np.int64)
            unwrap(clock, t, self.block)
            yield raw, t

    def _check_index(self, state: np.ndarray) -> None:
        """Raise FormatError if windows would miss events: blocks are too long for the index, or too far out of order.

        `state` is the clock's state after all records.
        """
        if state[HIDDEN] >= 0:
            reason = f"{self.block} records take more than 35 minutes: a window can't determine their times"
            raise FormatError(self.path, reason, offset=self._byte(int(state[HIDDEN])))
        if not state[FELL]:
            return
        count = -(-self.records // self.block)
        starts, lowest, highest = np.empty((3, count), np.int64)
        clock, k = clock_at(UNKNOWN, 0), 0
        for _, t in self._clocked(clock):
            extremes(t, self.block, starts[k:], lowest[k:], highest[k:])
            k += -(-t.size // self.block)
        self._check_blocks(starts, lowest, highest)


def _steps(times: np.ndarray) -> np.ndarray:
    """Return the differences between successive counter values along the last axis, at most half a wrap either way."""
    steps: np.ndarray = (np.diff(times) + WRAP_US // 2) % WRAP_US - WRAP_US // 2
    return steps


def with_times_of_32_bits(pieces: Iterable[Events], name: str) -> Iterator[Events]:
    """Yield the pieces. ValueError for times that a reader couldn't unwrap.

    Such times are a first time below 0 or of 2^32 - 1 µs or more, a gap of 2^31 µs or more, and a gap across a wrap
    that is longer than `SILENT_US`.
    """
    last = None
    for events in pieces:
        t = events.t
        gaps = np.diff(t, prepend=t[0] if last is None else last)
        long = np.flatnonzero(gaps > SILENT_US)
        wraps = t[long] // WRAP_US != (t[long] - gaps[long]) // WRAP_US
        if t[0] < 0 or (last is None and t[0] >= WRAP_US - 1) or wraps.any() or gaps.max() >= WRAP_US // 2:
            over = f"of at most {SILENT_US // 60_000_000} minutes where its counter wraps"
            raise ValueError(f"{name} supports a first time in [0, 2^32 - 1) µs and gaps below 2^31 µs only, {over}")
        last = t[-1]
        yield events
