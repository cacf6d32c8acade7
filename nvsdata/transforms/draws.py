"""The draws that random transforms make."""

from __future__ import annotations

import threading

import torch


class _Drawn(threading.local):
    """Tensors that draws are made into, for making one takes longer than the draw; one a thread."""

    def __init__(self) -> None:
        self.real = torch.empty(())
        self.whole = torch.empty((), dtype=torch.int64)


_drawn = _Drawn()


def uniform(low: float, high: float) -> float:
    """A number in [low, high) from torch's generator."""
    return low + (high - low) * _drawn.real.uniform_().item()


def below(bound: int) -> int:
    """An integer in [0, bound) from torch's generator."""
    return int(_drawn.whole.random_(bound).item())
