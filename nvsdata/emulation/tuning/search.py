"""Adaptive random search for the settings of PIX2NVS that come closest to a real recording (thesis 3.4.3)."""

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
from nvsdata.emulation.protocol import EventEmulator, settings_of
from nvsdata.emulation.tuning.space import Space, check, place_of, plain, settings_at, space_of
from nvsdata.metrics.distance import score

BATCH = 4  # trials proposed at once; the number of jobs doesn't change it, so that the search doesn't depend on jobs
ANYWHERE = 1  # trials of each batch drawn anywhere, so that the search can leave a local minimum
ANEW = 1  # trials of each batch in which one setting is drawn anew: choices have no neighbors in a small sphere
FIRST = 16  # trials drawn anywhere before the search narrows
SHRINK = 0.85  # factor of the radius after a batch that found nothing better
LEAST_RADIUS = 0.02
NEAR = 0.3  # radius around settings to begin with
MOVED = 0.3  # probability that a proposal changes a setting: the effects of few changes are easier to separate


class Measured(NamedTuple):
    """What settings give.

    - `distances`: from the real recording, smaller is better for all; NaN for settings that can't be judged
    - `events`: numbers of OFF and of ON events
    """

    distances: tuple[float, ...]
    events: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Trial:
    """Settings and what they give.

    - `settings`: an emulator
    - `distances`, `events`: see `Measured`
    """

    settings: Any
    distances: tuple[float, ...]
    events: tuple[int, int] = (0, 0)


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
    """Look for settings with a small score: first anywhere in `space`, then in a shrinking sphere around the best.

    With `start`, the search begins there.

    - `measure`: gives the distances of settings; an `objective.Pair` does
    - `space`: by name of each setting, its choices, a `Range` or `Depending` (default: the emulator's, `space_of`)
    - `base`: an emulator, whose settings outside the space stay as they are (default: `PIX2NVS()`)
    - `start`: settings for the first trial, such as those that `emulation.fit` finds (default: none)
    - `trials`: number of settings to try, those in the journal included (default 100)
    - `seed`: the same seed proposes the same trials (default 0)
    - `jobs`: trials measured at once, in threads (default 1)
    - `journal`: a file of JSON lines, by which a search that was stopped goes on (default: none)
    - `note`: kept in the journal's first line; must be the same when the search goes on

    Raises ValueError for a journal of another search, and for a space with settings that the emulator doesn't have.
    """
    base = base or PIX2NVS()
    space = space_of(base) if space is None else space
    check(space, base)
    head = {"nvsdata-search": 2, "seed": seed, "base": settings_of(base), "space": plain(space), **(note or {})}
    head |= {"start": settings_of(start)} if start else {}
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
            # always a whole batch is drawn, so that a short search goes on with the same trials as a long one has
            drawn = [_drawn(rng, len(space), None if wide else center, radius, i) for i in range(BATCH)][:count]
            proposed = [settings_at(base, space, place.tolist()) for place in drawn]
            first = len(result.trials)
            if start is not None and not first:
                drawn[0], proposed[0] = np.array(place_of(start, space)), start
            known = [done.get(first + i, settings) if done else None for i, settings in enumerate(proposed)]
            futures = [pool.submit(measure, s) if k is None else None for s, k in zip(proposed, known, strict=True)]
            # a search that is stopped ends with the trials that have begun
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
    """Cancel those that haven't begun if anything goes wrong."""
    try:
        yield
    finally:
        for future in filter(None, futures):
            future.cancel()


def _drawn(
    rng: np.random.Generator, dimensions: int, center: np.ndarray | None, radius: float, number: int
) -> np.ndarray:
    """A random place in the unit cube, by its `number` in the batch: anywhere (always without a `center`), on a line
    through `center`, or in a sphere around it, reflected where that sticks out."""
    anywhere = rng.random(dimensions)
    axis = np.arange(dimensions) == rng.integers(dimensions)
    direction, moved = rng.normal(size=dimensions), rng.random(dimensions) < MOVED
    length = radius * rng.random() ** (1 / dimensions)
    if center is None or number < ANYWHERE:
        return anywhere
    if number < ANYWHERE + ANEW:
        return np.where(axis, anywhere, center)
    # at least one, because the center itself is known
    direction *= moved if moved.any() else axis
    place = center + direction / max(float(np.linalg.norm(direction)), 1e-9) * length
    return np.asarray(np.clip(np.where(place < 0, -place, np.where(place > 1, 2 - place, place)), 0, 1))


class _Trials(Journal):
    """Trials on disk, a JSON line each, after a first line that identifies the search."""

    def __init__(self, path: Path, head: Mapping[str, Any], kind: Callable[..., Any]) -> None:
        plain = json.loads(json.dumps(head))
        super().__init__(path, plain)
        if self.head != plain:
            raise ValueError(f"{path} is of another search: give the same settings, or another file")
        self._known = {
            line["trial"]: Trial(kind(**line["settings"]), tuple(line["distances"]), tuple(line["events"]))
            for line in self.lines
        }

    def get(self, number: int, settings: Any) -> Trial | None:
        """The trial with that number, if it had these settings."""
        found = self._known.get(number)
        return found if found is not None and found.settings == settings else None

    def note(self, number: int, trial: Trial) -> None:
        """Add a trial."""
        settings = asdict(trial.settings)
        self.add({"trial": number, "distances": trial.distances, "events": trial.events, "settings": settings})
