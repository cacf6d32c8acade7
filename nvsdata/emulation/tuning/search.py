"""Adaptive random search for the settings of PIX2NVS that come closest to a real recording (thesis 3.4.3)."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from nvsdata.common.files import Journal
from nvsdata.emulation.pix2nvs import PIX2NVS
from nvsdata.emulation.protocol import EventEmulator, settings_of
from nvsdata.metrics.scoring import score

BATCH = 4  # trials proposed at once; the number of jobs doesn't change it, so that the search doesn't depend on jobs
ANYWHERE = 1  # trials of each batch drawn anywhere, so that the search can leave a local minimum
FIRST = 16  # trials drawn anywhere before the search narrows
SHRINK = 0.85  # factor of the radius after a batch that found nothing better
LEAST_RADIUS = 0.02
MOVED = 0.3  # probability that a proposal changes a setting: the effects of few changes are easier to separate


@dataclass(frozen=True)
class Range:
    """Numbers that a setting may have.

    - `low`, `high`: the least and the largest, both included
    - `log`: drawn evenly in their logarithm (default False)
    - `whole`: whole numbers only (default False)
    """

    low: float
    high: float
    log: bool = False
    whole: bool = False

    def at(self, share: float) -> float:
        """The number at a share (0 to 1) of the way from `low` to `high`."""
        if self.whole:
            return min(int(self.low + share * (self.high - self.low + 1)), int(self.high))
        if self.log:
            return math.exp(math.log(self.low) + share * (math.log(self.high) - math.log(self.low)))
        return self.low + share * (self.high - self.low)


Space = Mapping[str, Range | Sequence[Any]]

# what Table 3.3 varies, and the rate of the moving average
SPACE: Space = {
    "t_log": (0.0, 20.0),
    "inhibition": Range(1, 3, whole=True),
    "max_events": Range(1, 5, whole=True),
    "threshold": Range(0.05, 0.8, log=True),
    "new": (True, False),
    "exp": (True, False),
    "alpha": Range(0.1, 0.9),
}


@dataclass(frozen=True)
class Trial:
    """Settings and their distances.

    - `settings`: an emulator
    - `distances`: 1 - repeatability, Chamfer, EMD; NaN if no frame had spikes on both sides
    """

    settings: Any
    distances: tuple[float, float, float]


@dataclass
class Search:
    """Trials in the order in which they were made."""

    trials: list[Trial] = field(default_factory=list)

    @property
    def scores(self) -> np.ndarray:
        """Score of each trial, normalized over all trials (`metrics.score`), float64 [trials]; inf where it is NaN."""
        return np.asarray(np.nan_to_num(score([trial.distances for trial in self.trials]), nan=np.inf))

    @property
    def best(self) -> Trial:
        """The trial with the lowest score."""
        return self.trials[int(np.argmin(self.scores))]


def search(
    measure: Callable[[Any], tuple[float, float, float]],
    *,
    space: Space = SPACE,
    base: EventEmulator | None = None,
    trials: int = 100,
    seed: int = 0,
    jobs: int = 1,
    journal: Path | None = None,
    note: Mapping[str, Any] | None = None,
) -> Search:
    """Look for settings with a small score: first anywhere in `space`, then in a shrinking sphere around the best.

    - `measure`: gives the three distances of settings; an `objective.Pair` does
    - `space`: by name of each setting, its choices or a `Range` (default `SPACE`)
    - `base`: an emulator, whose settings outside the space stay as they are (default: `PIX2NVS()`)
    - `trials`: number of settings to try, those in the journal included (default 100)
    - `seed`: the same seed proposes the same trials (default 0)
    - `jobs`: trials measured at once, in threads (default 1)
    - `journal`: a file of JSON lines, by which a search that was stopped goes on (default: none)
    - `note`: kept in the journal's first line; must be the same when the search goes on

    Raises ValueError for a journal of another search, and for a space with settings that the emulator doesn't have.
    """
    base = base or PIX2NVS()
    for name, choices in space.items():
        if not hasattr(base, name):
            raise ValueError(f"{type(base).__name__} has no setting {name!r}")
        if not isinstance(choices, Range) and not choices:
            raise ValueError(f"no choices for {name}")
    head = {"nvsdata-search": 1, "seed": seed, "base": settings_of(base), "space": _plain(space), **(note or {})}
    rng = np.random.default_rng(seed)
    result = Search()
    center: np.ndarray | None = None
    radius = 1.0
    places: list[np.ndarray] = []
    with (
        _Trials(journal, head, type(base)) if journal else nullcontext() as done,
        ThreadPoolExecutor(jobs) as pool,
        tqdm(total=trials, desc="searching", unit="trial", disable=None) as bar,
    ):
        while len(result.trials) < trials:
            count = min(BATCH, trials - len(result.trials))
            wide = center is None or len(result.trials) < FIRST
            # always a whole batch is drawn, so that a short search goes on with the same trials as a long one has
            drawn = [_near(rng, len(space), None if wide or i < ANYWHERE else center, radius) for i in range(BATCH)][
                :count
            ]
            proposed = [_settings(base, space, place) for place in drawn]
            first = len(result.trials)
            known = [done.get(first + i, settings) if done else None for i, settings in enumerate(proposed)]
            futures = [pool.submit(measure, s) if k is None else None for s, k in zip(proposed, known, strict=True)]
            for settings, found, future in zip(proposed, known, futures, strict=True):
                trial = found or Trial(settings, _three(future.result() if future else ()))
                if found is None and done:
                    done.note(len(result.trials), trial)
                result.trials.append(trial)
                bar.update()
            places += drawn
            scores = result.scores
            best = int(np.argmin(scores))
            if not wide and best < len(scores) - count:
                radius = max(radius * SHRINK, LEAST_RADIUS)
            center = places[best]
            bar.set_postfix_str(f"score {scores[best]:.4f}", refresh=False)
    return result


def _near(rng: np.random.Generator, dimensions: int, center: np.ndarray | None, radius: float) -> np.ndarray:
    """A random place in the unit cube: anywhere, or in a sphere around `center`, reflected where that sticks out."""
    anywhere = rng.random(dimensions)
    direction = rng.normal(size=dimensions) * (rng.random(dimensions) < MOVED)
    length = radius * rng.random() ** (1 / dimensions)
    if center is None:
        return anywhere
    place = center + direction / max(float(np.linalg.norm(direction)), 1e-9) * length
    return np.asarray(np.clip(np.where(place < 0, -place, np.where(place > 1, 2 - place, place)), 0, 1))


def _settings(base: Any, space: Space, place: np.ndarray) -> Any:
    """The settings at a place of the unit cube."""
    chosen: dict[str, Any] = {}
    for (name, choices), share in zip(space.items(), place.tolist(), strict=True):
        if isinstance(choices, Range):
            chosen[name] = choices.at(share)
        else:
            chosen[name] = choices[min(int(share * len(choices)), len(choices) - 1)]
    return replace(base, **chosen)


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    a, b, c = (float(value) for value in values)
    return a, b, c


def _plain(space: Space) -> dict[str, Any]:
    return {k: asdict(v) if isinstance(v, Range) else list(v) for k, v in space.items()}


class _Trials(Journal):
    """Trials on disk, a JSON line each, after a first line that identifies the search."""

    def __init__(self, path: Path, head: Mapping[str, Any], kind: Callable[..., Any]) -> None:
        plain = json.loads(json.dumps(head))
        super().__init__(path, plain)
        if self.head != plain:
            raise ValueError(f"{path} is of another search: give the same settings, or another file")
        self._known = {line["trial"]: Trial(kind(**line["settings"]), _three(line["distances"])) for line in self.lines}

    def get(self, number: int, settings: Any) -> Trial | None:
        """The trial with that number, if it had these settings."""
        found = self._known.get(number)
        return found if found is not None and found.settings == settings else None

    def note(self, number: int, trial: Trial) -> None:
        """Add a trial."""
        self.add({"trial": number, "distances": trial.distances, "settings": asdict(trial.settings)})
