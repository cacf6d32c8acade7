"""The draws that random transforms make."""

from __future__ import annotations

import threading

import torch


class _Drawn(threading.local):
    """Tensors that draws are made into, for making one takes longer than the draw; one a thread.

    Drawn values are read through arrays on the same memory, without a call of torch.
    """

    def __init__(self) -> None:
        self.real = torch.empty(())
        self.whole = torch.empty((), dtype=torch.int64)
        self.real_value, self.whole_value = self.real.numpy(), self.whole.numpy()


_drawn = _Drawn()


def uniform(low: float, high: float) -> float:
    """A number in [low, high) from torch's generator."""
    _drawn.real.uniform_()
    return low + (high - low) * float(_drawn.real_value[()])


def below(bound: int) -> int:
    """An integer in [0, bound) from torch's generator."""
    _drawn.whole.random_(bound)
    return int(_drawn.whole_value[()])
