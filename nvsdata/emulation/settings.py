"""The settings of PIX2NVS, and the values that each may have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

Mode = Literal["LI", "CE", "LICE"]
Difference = Literal["co-located", "average", "minimum"]
Timestamps = Literal["interpolated", "random", "linear", "fixed"]
LEAST_THRESHOLD = 1e-5  # differences are of float32 values up to 100


@dataclass(frozen=True)
class Settings:
    """The parameters of Table 3.1 and of imperfect sensors; `PIX2NVS`, which adds the emulation, explains each.

    Raises ValueError for settings out of range.
    """

    hue: bool = False
    mode: Mode = "LI"
    t_log: float = 0.0
    gamma: float = 2.2
    continuous: bool = False
    difference: Difference = "co-located"
    inhibition: int = 1
    threshold: float = 0.2
    max_events: int = 3
    timestamps: Timestamps = "interpolated"
    new: bool = True
    exp: bool = True
    alpha: float = 0.5
    noise_rate: float = 0.0
    mismatch: float = 0.0
    hot_pixels: float = 0.0
    hot_rate: float = 100.0
    refractory: int = 0
    bandwidth: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, choices in (("mode", Mode), ("difference", Difference), ("timestamps", Timestamps)):
            if getattr(self, name) not in get_args(choices):
                raise ValueError(f"{name} must be one of {get_args(choices)}, not {getattr(self, name)!r}")
        _require(self, "threshold", lambda v: v >= LEAST_THRESHOLD, f"at least {LEAST_THRESHOLD}")
        _require(self, "gamma", lambda v: v > 0, "positive")
        for name in ("t_log", "noise_rate", "mismatch", "hot_rate", "refractory", "bandwidth"):
            _require(self, name, lambda v: v >= 0, "not negative")
        for name in ("inhibition", "max_events"):
            _require(self, name, lambda v: v >= 1 and v == int(v), "a whole number of at least 1")
        _require(self, "seed", lambda v: 0 <= v < 2**63 and v == int(v), "a whole number of at least 0")
        _require(self, "alpha", lambda v: 0 < v <= 1, "in (0, 1]")
        _require(self, "hot_pixels", lambda v: v <= 1 and v >= 0, "between 0 and 1")
        if self.continuous and 0 < self.t_log <= 1:
            raise ValueError(f"continuous needs t_log above 1, where its logarithm is positive, not {self.t_log}")


def _require(settings: Settings, name: str, holds: Any, what: str) -> None:
    value = getattr(settings, name)
    if not (math.isfinite(value) and holds(value)):
        raise ValueError(f"{name} must be {what}, not {value}")
