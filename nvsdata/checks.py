"""Checks of settings."""

from __future__ import annotations

import math


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
