"""Settings of PIX2NVS and DVS, and their allowed values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from nvsdata.common.validation import at_least, not_negative, positive, probability, whole
from nvsdata.video.upsample import Upsample

Mode = Literal["LI", "CE", "LICE"]
Difference = Literal["co-located", "average", "minimum"]
Timestamps = Literal["interpolated", "random", "linear", "fixed"]
LEAST_THRESHOLD = 1e-5  # about the spacing of float32 values at 100, the largest value of a pixel


@dataclass(frozen=True)
class PIX2NVSSettings:
    """Settings of `PIX2NVS`, whose docstring describes each.

    Raises:
        ValueError: A setting is out of range.
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
        at_least("threshold", self.threshold, LEAST_THRESHOLD)
        positive("gamma", self.gamma)
        for name in ("t_log", "noise_rate", "mismatch", "hot_rate", "refractory", "bandwidth"):
            not_negative(name, getattr(self, name))
        whole("inhibition", self.inhibition, 1)
        whole("max_events", self.max_events, 1)
        _check_seed(self.seed)
        positive("alpha", self.alpha)
        probability("alpha", self.alpha)
        probability("hot_pixels", self.hot_pixels)
        if self.continuous and 0 < self.t_log <= 1:
            raise ValueError(f"continuous needs t_log above 1, so that ln(t_log) is positive, not {self.t_log}")


@dataclass(frozen=True)
class DVSSettings:
    """Settings of `DVS`, whose docstring describes each.

    Raises:
        ValueError: A setting is out of range.
    """

    on: float = 0.3
    off: float = 0.3
    dark: float = 3.0
    upsample: Upsample | int = "none"
    mismatch: float = 0.0
    cutoff: float = 0.0
    leak: float = 0.0
    noise_rate: float = 0.0
    hot_pixels: float = 0.0
    hot_rate: float = 100.0
    refractory: int = 0
    bandwidth: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        at_least("on", self.on, LEAST_THRESHOLD)
        at_least("off", self.off, LEAST_THRESHOLD)
        at_least("dark", self.dark, 0.001)
        if isinstance(self.upsample, str):
            if self.upsample not in get_args(Upsample):
                raise ValueError(f"upsample must be a number or one of {get_args(Upsample)}, not {self.upsample!r}")
        elif not isinstance(self.upsample, int) or self.upsample < 1:
            raise ValueError(f"upsample must be a whole number of at least 1, not {self.upsample}")
        for name in ("mismatch", "cutoff", "leak", "noise_rate", "hot_rate", "refractory", "bandwidth"):
            not_negative(name, getattr(self, name))
        probability("hot_pixels", self.hot_pixels)
        _check_seed(self.seed)


def _check_seed(seed: int) -> None:
    whole("seed", seed)
    if seed >= 1 << 63:
        raise ValueError(f"seed must be below 2**63, not {seed}")
