"""Random numbers for transforms."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import torch


class _Drawn(threading.local):
    """Tensors that draws fill, one set per thread, because allocating one takes longer than the draw.

    Drawn values are read through arrays on the same memory, without calling torch.
    """

    def __init__(self) -> None:
        self.real = torch.empty(())
        self.whole = torch.empty((), dtype=torch.int64)
        self.real_value, self.whole_value = self.real.numpy(), self.whole.numpy()
        self.generator: torch.Generator | None = None  # torch's default one
        self.share: float | None = None


_drawn = _Drawn()


def uniform(low: float, high: float) -> float:
    """A number in [low, high)."""
    _drawn.real.uniform_(generator=_drawn.generator)
    return low + (high - low) * float(_drawn.real_value[()])


def randint(bound: int) -> int:
    """An integer in [0, bound)."""
    _drawn.whole.random_(bound, generator=_drawn.generator)
    return int(_drawn.whole_value[()])


def place(bound: int) -> int:
    """Where in time a window begins, an integer in [0, bound): random, or fixed for a voter (`of_voter`)."""
    return randint(bound) if _drawn.share is None else int(_drawn.share * bound)


def generator() -> torch.Generator | None:
    """The generator to pass to torch's functions; None for the default one."""
    return _drawn.generator


@contextmanager
def of_voter(number: int, count: int) -> Iterator[None]:
    """Within the block, the random numbers of this thread's transforms depend on `number` alone.

    Places in time aren't random: those of `count` voters are spread evenly. torch's own generators are neither read
    nor advanced.
    """
    before = _drawn.generator, _drawn.share
    _drawn.generator, _drawn.share = torch.Generator().manual_seed(number), (number + 0.5) / count
    try:
        yield
    finally:
        _drawn.generator, _drawn.share = before
