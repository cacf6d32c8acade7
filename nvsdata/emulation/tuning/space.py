"""Space of the settings that a search may choose."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from nvsdata.emulation.settings import DVSSettings, PIX2NVSSettings


@dataclass(frozen=True)
class Range:
    """Range of numbers that a setting may have.

    Args:
        low: Smallest number.
        high: Largest number.
        log: Sample uniformly in the logarithm.
        whole: Whole numbers only.

    Example:
        >>> Range(1, 3, whole=True).at(0.5)
        2
    """

    low: float
    high: float
    log: bool = False
    whole: bool = False

    def at(self, share: float) -> float:
        """Return the number at a fraction (0 to 1) of the way from `low` to `high`.

        If `log`, it is a fraction of the logarithm. If `whole`, each integer has an equal part of the fractions.
        """
        if self.whole:
            return min(int(self.low + share * (self.high - self.low + 1)), int(self.high))
        if self.log:
            return math.exp(math.log(self.low) + share * (math.log(self.high) - math.log(self.low)))
        return self.low + share * (self.high - self.low)

    def share(self, number: float) -> float:
        """Return the fraction (0 to 1) for which `at` returns `number`, or the number nearest to it in the range."""
        if self.whole:
            share = (number - self.low + 0.5) / (self.high - self.low + 1)
        elif self.log:
            share = math.log(max(number, self.low) / self.low) / math.log(self.high / self.low)
        else:
            share = (number - self.low) / (self.high - self.low)
        return min(max(share, 0.0), 1.0)


Choices = Range | Sequence[Any]


@dataclass(frozen=True)
class Depending:
    """Choices that depend on another setting.

    Args:
        on: Name of the other setting; in a space it comes before this one.
        given: Choices by the value of the other setting.
        other: Choices for all other values.
    """

    on: str
    given: Mapping[Any, Choices]
    other: Choices

    def choices(self, settings: Any) -> Choices:
        """Return the choices for the value in `settings`."""
        return self.given.get(getattr(settings, self.on), self.other)


Space = Mapping[str, Choices | Depending]

# the settings that Table 3.3 of the thesis varies, and alpha, mode, hue, difference and noise. Thresholds of contrast
# (CE) have another scale, and contrast isn't defined for hue
SPACE: Space = {
    "mode": ("LI", "CE", "LICE"),
    "hue": Depending("mode", {"LI": (False, True)}, (False,)),
    "difference": ("co-located", "average", "minimum"),
    "t_log": (0.0, 20.0),
    "inhibition": Range(1, 3, whole=True),
    "max_events": Range(1, 5, whole=True),
    "threshold": Depending("mode", {"CE": Range(1.0, 16.0, log=True)}, Range(0.05, 0.8, log=True)),
    "new": (True, False),
    "exp": (True, False),
    "alpha": Range(0.1, 0.9),
    "noise_rate": Range(0.0, 5.0),
}

# the settings that `fit` estimates, and mismatch and cutoff
SENSOR_SPACE: Space = {
    "on": Range(0.05, 0.8, log=True),
    "off": Range(0.05, 0.8, log=True),
    "dark": Range(0.5, 50.0, log=True),
    "mismatch": Range(0.0, 0.4),
    "cutoff": (0.0, 30.0, 100.0, 300.0),
    "leak": Range(0.0, 2.0),
    "noise_rate": Range(0.0, 5.0),
    "refractory": Range(0, 5_000, whole=True),
}


def space_of(emulator: Any) -> Space:
    """Return the default space of a built-in emulator; raise ValueError for another emulator."""
    if isinstance(emulator, DVSSettings):
        return SENSOR_SPACE
    if isinstance(emulator, PIX2NVSSettings):
        return SPACE
    raise ValueError(f"{type(emulator).__name__} has no default space: pass one, as `space`")


def check_space(space: Space, base: Any) -> None:
    """Raise ValueError for a space with settings that the emulator `base` doesn't have, or without choices."""
    for name, choices in space.items():
        names = (name, choices.on) if isinstance(choices, Depending) else (name,)
        for one in names:
            if not hasattr(base, one):
                raise ValueError(f"{type(base).__name__} has no setting {one!r}")
        sets = (*choices.given.values(), choices.other) if isinstance(choices, Depending) else (choices,)
        if not all(isinstance(some, Range) or some for some in sets):
            raise ValueError(f"the space has no choices for {name}")


def settings_at(base: Any, space: Space, place: Sequence[float]) -> Any:
    """Return the settings at a point of the unit cube, which has an axis per setting of the space."""
    settings = base
    for (name, choices), share in zip(space.items(), place, strict=True):
        if isinstance(choices, Depending):
            choices = choices.choices(settings)
        settings = replace(settings, **{name: _at(choices, share)})
    return settings


def place_of(settings: Any, space: Space) -> list[float]:
    """Return the point of the unit cube at which `settings_at` returns these settings, or the nearest ones."""
    place = []
    for name, choices in space.items():
        if isinstance(choices, Depending):
            choices = choices.choices(settings)
        place.append(_share(choices, getattr(settings, name)))
    return place


def _share(choices: Choices, value: Any) -> float:
    if isinstance(choices, Range):
        return choices.share(value)
    if value in choices:
        return (choices.index(value) + 0.5) / len(choices)
    near = min(range(len(choices)), key=lambda n: abs(choices[n] - value)) if isinstance(value, int | float) else 0
    return (near + 0.5) / len(choices)


def _at(choices: Choices, share: float) -> Any:
    return (
        choices.at(share) if isinstance(choices, Range) else choices[min(int(share * len(choices)), len(choices) - 1)]
    )


def space_to_json(space: Space) -> dict[str, Any]:
    """Convert the space to values that JSON can store."""
    return {name: _plain(choices) for name, choices in space.items()}


def _plain(choices: Choices | Depending) -> Any:
    if isinstance(choices, Depending):
        given = {str(value): _plain(some) for value, some in choices.given.items()}
        return {"on": choices.on, "given": given, "other": _plain(choices.other)}
    return asdict(choices) if isinstance(choices, Range) else list(choices)
