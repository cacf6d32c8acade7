"""Checks of settings, and the draws that random transforms make."""

from __future__ import annotations

import math
import threading

import torch


class _Drawn(threading.local):
    """Tensors that draws are made into, for making one takes longer than the draw; one a thread."""

    def __init__(self) -> None:
        self.real = torch.empty(())
        self.whole = torch.empty((), dtype=torch.int64)


_drawn = _Drawn()


def positive(name: str, value: float) -> None:
    """ValueError unless value > 0 and finite."""
    if not (value > 0 and math.isfinite(value)):
        raise ValueError(f"{name} must be positive, not {value}")


def not_negative(name: str, value: float) -> None:
    """ValueError unless value >= 0 and finite."""
    if not (value >= 0 and math.isfinite(value)):
        raise ValueError(f"{name} must not be negative, not {value}")


def probability(name: str, value: float) -> None:
    """ValueError unless 0 <= value <= 1."""
    if not 0 <= value <= 1:
        raise ValueError(f"{name} must lie between 0 and 1, not {value}")


def uniform(low: float, high: float) -> float:
    """A number in [low, high) from torch's generator."""
    return low + (high - low) * _drawn.real.uniform_().item()


def below(bound: int) -> int:
    """An integer in [0, bound) from torch's generator."""
    return int(_drawn.whole.random_(bound).item())
