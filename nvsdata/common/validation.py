"""Checks of settings."""

from __future__ import annotations

import math


def positive(name: str, value: float) -> None:
    """Raise ValueError unless `value` is finite and > 0; the message calls the value `name`."""
    if not (value > 0 and math.isfinite(value)):
        raise ValueError(f"{name} must be positive, not {value}")


def not_negative(name: str, value: float) -> None:
    """Raise ValueError unless `value` is finite and >= 0."""
    if not (value >= 0 and math.isfinite(value)):
        raise ValueError(f"{name} must not be negative, not {value}")


def factors(low: float, high: float) -> None:
    """Raise ValueError unless 0 < `low` <= `high`, as for a range from which a factor is sampled."""
    positive("low", low)
    positive("high", high)
    if high < low:
        raise ValueError(f"high must be at least low, not {high} < {low}")


def probability(name: str, value: float) -> None:
    """Raise ValueError unless 0 <= `value` <= 1."""
    if not 0 <= value <= 1:
        raise ValueError(f"{name} must be between 0 and 1, not {value}")


def at_least(name: str, value: float, least: float) -> None:
    """Raise ValueError unless `value` is finite and >= `least`."""
    if not (value >= least and math.isfinite(value)):
        raise ValueError(f"{name} must be at least {least}, not {value}")


def whole(name: str, value: float, least: int = 0) -> None:
    """Raise ValueError unless `value` is a whole number of at least `least`."""
    if not (math.isfinite(value) and value == int(value) and value >= least):
        raise ValueError(f"{name} must be a whole number of at least {least}, not {value}")


def microseconds(name: str, value: float) -> None:
    """Raise ValueError unless `value` is a whole number of µs, at least one."""
    whole_microseconds(name, value)
    positive(name, value)


def whole_microseconds(name: str, value: float) -> None:
    """Raise ValueError unless `value` is a whole number of µs; a fraction was probably meant in seconds."""
    if not math.isfinite(value) or value != int(value):
        meant = f" ({value} s are {round(value * 1e6)})" if 0 < value < 1000 else ""
        raise ValueError(f"{name} counts whole µs, not {value}{meant}")


def transform(value: object) -> None:
    """Raise TypeError unless `value` can be called."""
    if not callable(value):
        raise TypeError(f"a transform must be callable, not {value!r}")
