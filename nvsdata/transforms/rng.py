"""Random numbers for transforms."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import torch


class _Scratch(threading.local):
    """Tensors of each thread to which random numbers are written, because allocating a tensor takes longer.

    The numbers are read through arrays on the same memory, without calling torch.
    """

    def __init__(self) -> None:
        self.real = torch.empty(())
        self.whole = torch.empty((), dtype=torch.int64)
        self.real_value, self.whole_value = self.real.numpy(), self.whole.numpy()
        self.generator: torch.Generator | None = None  # None: torch's default generator
        self.fraction: float | None = None  # position in the range of `window_start`, from 0 to 1; None: random


_scratch = _Scratch()


def uniform(low: float, high: float) -> float:
    """Return a random number in [low, high)."""
    _scratch.real.uniform_(generator=_scratch.generator)
    return low + (high - low) * float(_scratch.real_value[()])


def randint(bound: int) -> int:
    """Return a random integer in [0, bound)."""
    _scratch.whole.random_(bound, generator=_scratch.generator)
    return int(_scratch.whole_value[()])


def window_start(bound: int) -> int:
    """Return the start of a window, an integer in [0, bound): random, but fixed within `deterministic_rng`."""
    return randint(bound) if _scratch.fraction is None else int(_scratch.fraction * bound)


def generator() -> torch.Generator | None:
    """Return the generator to pass to torch's functions; None for the default one."""
    return _scratch.generator


@contextmanager
def deterministic_rng(number: int, count: int) -> Iterator[None]:
    """Make the random numbers of this thread's transforms depend on `number` alone, within the block.

    Windows start at the middle of part `number` of `count` equal parts of their range, so that the windows of several
    numbers are spread over a recording. torch's own generators are neither read nor advanced.
    """
    before = _scratch.generator, _scratch.fraction
    _scratch.generator, _scratch.fraction = torch.Generator().manual_seed(number), (number + 0.5) / count
    try:
        yield
    finally:
        _scratch.generator, _scratch.fraction = before
