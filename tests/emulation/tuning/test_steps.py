"""Single steps of the search by their definition, and what a pair of video and recording measures."""

import json
import math
from contextlib import nullcontext
from dataclasses import dataclass

import numpy as np
import pytest

from nvsdata import Events
from nvsdata.emulation import PIX2NVS
from nvsdata.emulation.tuning.objective import TuningPair
from nvsdata.emulation.tuning.report import trials_table
from nvsdata.emulation.tuning.search import Measured, Search, Trial, search
from nvsdata.emulation.tuning.space import Range


@dataclass(frozen=True)
class Place:
    """An emulator with two settings, and the events that it gives whatever it's shown."""

    a: float = 0.5
    b: float = 0.5
    events: Events | None = None

    def emulate(self, video, *, fps=None, times=None, size=None):
        return self.events


UNIT = {"a": Range(0, 1), "b": Range(0, 1)}
FIRST, BATCH = 16, 4


def places(found):
    return np.array([(trial.settings.a, trial.settings.b) for trial in found.trials])


def test_a_search_that_finds_nothing_better_narrows_by_15_percent_a_batch():
    where = places(search(lambda _: Measured((1.0, 1.0, 1.0)), space=UNIT, base=Place(), trials=FIRST + 150 * BATCH))
    # of equal ones, the first trial is the best
    near, anywhere, anew = [], [], []
    for number, batch in enumerate(where[FIRST:].reshape(150, BATCH, 2)):
        radius = max(0.85**number, 0.02)
        anywhere.append(batch[0])
        anew.append(batch[1])
        near += [(number, np.linalg.norm(place - where[0]) / radius) for place in batch[2:]]
    shares = np.array([share for _, share in near])
    assert shares.max() <= 1 + 1e-9
    late = np.array([share for number, share in near if number > 30])
    assert late.max() > 0.9
    assert max(share for number, share in near if number < 9) > 0.8
    # evenly over the disk's area
    assert np.median(late) == pytest.approx(math.sqrt(0.5), abs=0.08)
    # each setting moves with a probability of 0.3, one of them always
    both = (where[FIRST:].reshape(150, BATCH, 2)[:, 2:] != where[0]).all(2)
    assert both.mean() == pytest.approx(0.09, abs=0.05)
    assert late.min() > 0
    assert np.ptp(anywhere, axis=0).min() > 0.8
    # one setting of the second trial in each batch may be any
    moved = np.array(anew) != where[0]
    assert (moved.sum(1) == 1).all()
    assert moved.mean(0) == pytest.approx([0.5, 0.5], abs=0.2)
    assert np.ptp(anew, axis=0).min() > 0.8
    assert np.ptp(where[:FIRST], axis=0).min() > 0.6


def test_a_search_that_always_finds_better_does_not_narrow():
    calls = []

    def better(settings):
        """Each batch begins with the best trial so far."""
        calls.append((settings.a, settings.b))
        number = len(calls) - 1
        far = 100.0 - number if number % BATCH == 0 else 200.0
        return Measured((far, far, far))

    where = places(search(better, space=UNIT, base=Place(), trials=FIRST + 15 * BATCH))
    apart = [
        np.linalg.norm(where[n + i] - where[n - BATCH]) for n in range(FIRST, len(where), BATCH) for i in (1, 2, 3)
    ]
    assert max(apart[-15:]) > 0.3


def test_progress_counts_trials_and_tells_the_best_score(monkeypatch):
    result = []

    class Bar(nullcontext):
        def __init__(self, things, what, total, **options):
            super().__init__(self)
            result.append(total)

        def update(self, number=1):
            result.append(number)

        def set_postfix_str(self, text, refresh):
            result.append(text)

    monkeypatch.setattr("nvsdata.emulation.tuning.search.progress", Bar)
    search(lambda _: Measured((1.0, 1.0, 1.0)), space=UNIT, base=Place(), trials=6)
    assert result == [6, 1, 1, 1, 1, "score 0.5000", 1, 1, f"score {6**-0.5:.4f}"]


def test_a_journal_counts_for_the_settings_that_it_names(tmp_path):
    journal, calls = tmp_path / "a.jsonl", []

    def measure(settings):
        calls.append(settings)
        return Measured((settings.a, settings.b, 1.0), (3, 4))

    def run():
        calls.clear()
        return search(measure, space=UNIT, base=Place(), trials=6, journal=journal).trials

    trials = run()
    assert calls == [trial.settings for trial in trials]
    assert (run(), calls) == (trials, [])
    head, *lines = journal.read_text().splitlines()
    wrong = json.loads(lines[2])
    wrong["settings"]["a"], wrong["distances"] = 0.125, [9, 9, 9]
    journal.write_text("\n".join([head, *lines[:2], json.dumps(wrong), *lines[3:], ""]))
    assert run() == trials
    assert calls == [trials[2].settings]
    assert (run(), calls) == (trials, [])


def test_proposals_beyond_the_edge_are_reflected():
    def corner(settings):
        return Measured((settings.a + 1 - settings.b,) * 3)

    where = places(search(corner, space=UNIT, base=Place(), trials=200))
    assert ((where >= 0) & (where <= 1)).all()
    assert not np.isin(where, (0, 1)).any()
    assert where[-40:, 0].min() < 0.02
    assert where[-40:, 1].max() > 0.98


def test_a_search_of_any_length_begins_alike():
    trials = search(lambda s: Measured((s.a, s.b, 1.0)), space=UNIT, base=Place(), trials=30).trials
    for length in (0, 1, 5, 16, 17, 29):
        assert (
            search(lambda s: Measured((s.a, s.b, 1.0)), space=UNIT, base=Place(), trials=length).trials
            == trials[:length]
        )


def test_no_trial_repeats_the_best_one():
    """With two settings, neither would move in half of the proposals around it."""
    found = search(lambda s: Measured((s.a, s.b, 1.0)), space=UNIT, base=Place(), trials=80).trials
    assert len({(trial.settings.a, trial.settings.b) for trial in found}) == 80


@pytest.mark.parametrize("share", [0, 0.24, 0.26, 0.5, 0.99, 1])
def test_a_share_of_the_way_chooses(share):
    assert Range(2, 5, whole=True).at(share) == 2 + min(int(4 * share), 3)
    assert Range(2, 5).at(share) == 2 + 3 * share
    assert Range(2, 5, log=True).at(share) == pytest.approx(2 * 2.5**share)


FRAMES = [np.full((6, 8), value, np.uint8) for value in (10, 30, 90, 30, 10)]
REAL = Events([0, 5, 100_000, 149_999, 150_000, 200_000, 399_999], *[[1] * 7] * 3, (8, 6), start=0, end=500_000)


@pytest.mark.parametrize(
    ("settings", "frames", "times"),
    [
        ({}, 5, [0, 5, 100_000, 149_999, 150_000, 200_000, 399_999]),
        ({"seconds": 0.2}, 3, [0, 5, 100_000, 149_999, 150_000]),
        ({"seconds": 0.1999}, 2, [0, 5]),
        ({"seconds": 0.2, "offset": 50_000}, 3, [0, 5, 100_000, 149_999]),
        ({"seconds": 0.1, "offset": 100_000}, 2, [0]),
        ({"seconds": 0.1, "offset": 200_000}, 2, [0]),
    ],
)
def test_a_pair_has_the_frames_and_events_of_the_time_that_counts(settings, frames, times):
    pair = TuningPair(REAL, FRAMES, fps=10, **settings)
    assert [frame.time for frame in pair.frames] == [100_000 * n for n in range(frames)]
    assert pair.real.t.tolist() == times
    assert pair.fps == pytest.approx(10)
    assert pair.offset == settings.get("offset", 0)


@pytest.mark.parametrize(("seconds", "count"), [(0.0999, 1), (-1, 0)])
def test_a_pair_needs_two_frames(seconds, count):
    with pytest.raises(ValueError, match=f": {count} frames in the time that is compared, at least 2 are needed"):
        TuningPair(REAL, FRAMES, fps=10, seconds=seconds)


def at_frames(numbers):
    """An event in each of some frames at 10 per second."""
    ones = [1] * len(numbers)
    return Events([100_000 * n + 50_000 for n in numbers], ones, ones, ones, (8, 6), start=0, end=400_000)


@pytest.mark.parametrize(
    ("real", "emulated", "counts"),
    [
        ([0, 1, 2, 3], [0, 1, 2, 3], True),
        ([0, 1, 2, 3], [0, 2], True),
        ([0, 1, 2, 3], [2], False),
        ([0, 1, 2], [0], False),
        ([0], [0, 1, 2], True),
        ([0], [1], False),
        ([], [1], False),
    ],
)
def test_settings_that_miss_most_frames_do_not_count(real, emulated, counts):
    for one_way in (True, False):
        found = TuningPair(at_frames(real), FRAMES, fps=10, one_way=one_way)(Place(events=at_frames(emulated)))
        apart = [] if one_way else [0, math.log((len(emulated) + 1) / (len(real) + 1))]
        expected = [0, 0, 0, *map(abs, apart)] if counts else [math.nan] * (3 + len(apart))
        assert found.distances == pytest.approx(expected, nan_ok=True)
        assert found.events == (0, len(emulated))


def test_the_table_goes_from_the_worst_to_the_best_in_even_steps():
    distances = [0.5, 0.1, 0.9, math.nan, 0.7, 0.3]
    found = Search([Trial(PIX2NVS(threshold=0.1 + d if d == d else 5), (d, d, d), (1234, 5)) for d in distances])
    norm = math.sqrt(sum(d * d for d in distances if d == d))
    for rows, chosen in (
        (1, [0.1]),
        (2, [0.9, 0.1]),
        (3, [0.9, 0.5, 0.1]),
        (5, [0.9, 0.7, 0.5, 0.3, 0.1]),
        (9, [0.9, 0.7, 0.5, 0.3, 0.1]),
    ):
        head, *lines = (line.split() for line in trials_table(found, rows).splitlines())
        assert head == "T_log B M_max T_map new exp alpha Inv. e-rep Chamfer EMD Score OFF ON".split()
        assert lines == [
            ["0", "1", "3", f"{0.1 + d:.3g}", "True", "True", "0.5", *[f"{d:.3f}"] * 3, f"{d / norm:.3f}", "1,234", "5"]
            for d in chosen
        ]
    assert found.best.distances == (0.1, 0.1, 0.1)
    assert trials_table(found, 2, real=(7, 1000)).splitlines()[-1].split() == ["camera", "7", "1,000"]
    other = Search([Trial(Place(0.25), (1.0, 1.0, 1.0))])
    assert trials_table(other).splitlines()[0].split()[:3] == ["a", "b", "events"]
