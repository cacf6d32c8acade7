"""Adaptive random search for the settings whose events are nearest to a real recording (thesis, section 3.4.3)."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from nvsdata.common.files import Journal
from nvsdata.common.progress import bar as progress
from nvsdata.emulation.pix2nvs import PIX2NVS
from nvsdata.emulation.protocol import EventEmulator, describe_settings
from nvsdata.emulation.tuning.space import Space, check_space, place_of, settings_at, space_of, space_to_json
from nvsdata.metrics.distance import score

BATCH = 4  # trials that are proposed together; fixed, so that the search doesn't depend on the number of jobs
ANYWHERE = 1  # trials of each batch sampled anywhere, so that the search can leave a local minimum
# trials of each batch with one setting sampled anywhere, because a small sphere has only one value of a choice
RESAMPLED = 1
FIRST = 16  # trials sampled anywhere before the search narrows
SHRINK = 0.85  # factor of the radius after a batch that found nothing better
LEAST_RADIUS = 0.02
NEAR = 0.3  # radius around the settings of `start`
MOVED = 0.3  # probability that a proposal changes a setting; effects of few changes are easier to separate


class Measured(NamedTuple):
    """Measured quality of settings.

    Args:
        distances: Distances from the real recording, smaller is better; NaN if they can't be measured.
        events: Numbers of OFF and of ON events.
    """

    distances: tuple[float, ...]
    events: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Trial:
    """Settings and their measured quality.

    Args:
        settings: An emulator.
        distances: See `Measured`.
        events: See `Measured`.
    """

    settings: Any
    distances: tuple[float, ...]
    events: tuple[int, int] = (0, 0)


@dataclass
class Search:
    """Trials of a search, in order."""

    trials: list[Trial] = field(default_factory=list)

    @property
    def scores(self) -> np.ndarray:
        """Score of each trial, normalized over all trials (`metrics.score`), float64 [trials]; inf for NaN."""
        return np.asarray(np.nan_to_num(score([trial.distances for trial in self.trials]), nan=np.inf))

    @property
    def best(self) -> Trial:
        """The trial with the lowest score."""
        return self.trials[int(np.argmin(self.scores))]


def search(
    measure: Callable[[Any], Measured],
    *,
    space: Space | None = None,
    base: EventEmulator | None = None,
    start: EventEmulator | None = None,
    trials: int = 100,
    seed: int = 0,
    jobs: int = 1,
    journal: Path | None = None,
    note: Mapping[str, Any] | None = None,
) -> Search:
    """Search for settings with a small score: first anywhere in `space`, then in a shrinking sphere around the best.

    Args:
        measure: Function that measures an emulator, such as a `TuningPair`.
        space: Choices, a `Range` or `Depending` of each setting by name (default: `space_of(base)`).
        base: Emulator whose settings outside the space stay fixed (default: `PIX2NVS()`).
        start: Settings of the first trial, around which the search begins, such as those of `emulation.fit`.
        trials: Number of trials, including those in the journal.
        seed: Seed of the proposals.
        jobs: Number of threads that measure.
        journal: File of trials, from which a search that was stopped resumes.
        note: Entries of the journal's first line, which must be the same when the search resumes.

    Returns:
        A `Search` with all trials; its `best` has the lowest score.

    Raises:
        ValueError: The journal belongs to another search, or the space has a setting that the emulator doesn't have.

    Example:
        >>> def measure(emulator):
        ...     return Measured((abs(emulator.threshold - 0.3),))
        >>> found = search(measure, space={"threshold": (0.1, 0.3, 0.5)}, trials=12)
        >>> found.best.settings.threshold
        0.3
    """
    base = base or PIX2NVS()
    space = space_of(base) if space is None else space
    check_space(space, base)
    head = {
        "nvsdata-search": 2,
        "seed": seed,
        "base": describe_settings(base),
        "space": space_to_json(space),
        **(note or {}),
    }
    head |= {"start": describe_settings(start)} if start else {}
    rng = np.random.default_rng(seed)
    result = Search()
    center = None if start is None else np.array(place_of(start, space))
    radius = 1.0 if start is None else NEAR
    places: list[np.ndarray] = []
    with (
        _Trials(journal, head, type(base)) if journal else nullcontext() as done,
        ThreadPoolExecutor(jobs) as pool,
        progress(None, "searching", total=trials, unit="trial") as bar,
    ):
        while len(result.trials) < trials:
            count = min(BATCH, trials - len(result.trials))
            wide = start is None and (center is None or len(result.trials) < FIRST)
            # always sample a full batch, so that a short search proposes the same trials as a long one
            drawn = [_drawn(rng, len(space), None if wide else center, radius, i) for i in range(BATCH)][:count]
            proposed = [settings_at(base, space, place.tolist()) for place in drawn]
            first = len(result.trials)
            if start is not None and not first:
                drawn[0], proposed[0] = np.array(place_of(start, space)), start
            known = [done.get(first + i, settings) if done else None for i, settings in enumerate(proposed)]
            futures = [pool.submit(measure, s) if k is None else None for s, k in zip(proposed, known, strict=True)]
            # a search that is stopped finishes the trials that have begun
            with _cancelling(futures):
                for settings, found, future in zip(proposed, known, futures, strict=True):
                    trial = found or Trial(settings, *(future.result() if future else Measured(())))
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


@contextmanager
def _cancelling(futures: Sequence[Future[Measured] | None]) -> Iterator[None]:
    """Cancel the futures that haven't begun when the block ends."""
    try:
        yield
    finally:
        for future in filter(None, futures):
            future.cancel()


def _drawn(
    rng: np.random.Generator, dimensions: int, center: np.ndarray | None, radius: float, number: int
) -> np.ndarray:
    """Sample a point in the unit cube.

    Depending on its `number` in the batch, the point is anywhere (always without a `center`), on an axis through
    `center`, or in a sphere around it, reflected at the borders of the cube.
    """
    anywhere = rng.random(dimensions)
    axis = np.arange(dimensions) == rng.integers(dimensions)
    direction, moved = rng.normal(size=dimensions), rng.random(dimensions) < MOVED
    length = radius * rng.random() ** (1 / dimensions)
    if center is None or number < ANYWHERE:
        return anywhere
    if number < ANYWHERE + RESAMPLED:
        return np.where(axis, anywhere, center)
    # move along one axis at least, because the center itself is known
    direction *= moved if moved.any() else axis
    place = center + direction / max(float(np.linalg.norm(direction)), 1e-9) * length
    return np.asarray(np.clip(np.where(place < 0, -place, np.where(place > 1, 2 - place, place)), 0, 1))


class _Trials(Journal):
    """Journal of trials, a line of JSON each; its first line identifies the search."""

    def __init__(self, path: Path, head: Mapping[str, Any], kind: Callable[..., Any]) -> None:
        space_to_json = json.loads(json.dumps(head))
        super().__init__(path, space_to_json)
        if self.head != space_to_json:
            raise ValueError(f"{path} belongs to another search: use the same settings, or another file")
        self._known = {
            line["trial"]: Trial(kind(**line["settings"]), tuple(line["distances"]), tuple(line["events"]))
            for line in self.lines
        }

    def get(self, number: int, settings: Any) -> Trial | None:
        """Return the trial with that number if it had these settings."""
        found = self._known.get(number)
        return found if found is not None and found.settings == settings else None

    def note(self, number: int, trial: Trial) -> None:
        """Add a trial."""
        settings = asdict(trial.settings)
        self.add({"trial": number, "distances": trial.distances, "events": trial.events, "settings": settings})
