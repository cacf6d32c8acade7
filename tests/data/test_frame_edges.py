"""Which events fall into which frame, against slow loops."""

from fractions import Fraction

import numpy as np
import pytest

from nvsdata import Events
from nvsdata.data import frame_edges as frames
from nvsdata.data.events import LATEST


def at(times, **options):
    n = len(times)
    return Events(times, [0] * n, [0] * n, [0] * n, **options)


@pytest.mark.parametrize(
    ("duration", "fps", "edges"),
    [
        (0, None, [0, 1]),
        (1, None, [0, 1]),
        (2, None, [0, 2]),
        (0, 1_000, [0, 1_000]),
        (1, 1_000, [0, 1_000]),
        (1_000, 1_000, [0, 1_000]),
        (1_001, 1_000, [0, 1_000, 2_000]),
        (3_000, 1_000, [0, 1_000, 2_000, 3_000]),
        (66_667, 30, [0, 33_333, 66_667]),
        (66_668, 30, [0, 33_333, 66_667, 100_000]),
    ],
)
def test_frames_cover_the_duration(duration, fps, edges):
    found = frames.frame_edges(duration, fps)
    assert found.tolist() == edges
    assert found.dtype == np.int64


@pytest.mark.parametrize("fps", [24, 29.97, 30, 239.76])
def test_edges_are_the_nearest_microseconds(fps):
    wanted = [round(Fraction(n * 1_000_000) / Fraction(fps)) for n in range(200)]
    assert frames.frame_edges(wanted[-1], fps).tolist() == wanted


def test_as_many_frames_as_there_may_be(monkeypatch):
    frames.check_count(2**24)
    with pytest.raises(ValueError, match=r"^16,777,217 frames are more than the 16,777,216 allowed: use longer"):
        frames.check_count(2**24 + 1)
    with pytest.raises(ValueError, match=r"^10,000,000 s are 20,000,000 frames, which are too many: check `Events"):
        frames.frame_edges(10**13, 2)
    monkeypatch.setattr(frames, "MAX_FRAMES", 10)
    assert len(frames.frame_edges(10_000, 1_000)) == 11
    with pytest.raises(ValueError, match="0 s are 11 frames"):
        frames.frame_edges(10_001, 1_000)
    with pytest.raises(ValueError, match=r"^2 s are 20 frames"):
        frames.frame_edges(1_999_999, 10)
    ten = at(range(10))
    assert frames.count_bounds(ten, 1).tolist() == list(range(11))
    assert frames.equal_bounds(ten, 10).tolist() == [*range(10), 10]
    assert len(frames.duration_bounds(at([0, 30]), 3)) == 11
    for refused in (
        lambda: frames.count_bounds(at(range(11)), 1),
        lambda: frames.equal_bounds(ten, 11),
        lambda: frames.duration_bounds(at([0, 31]), 3),
    ):
        with pytest.raises(ValueError, match="11 frames are more than the 10 allowed"):
            refused()


def test_a_frame_has_the_events_after_its_beginning_and_at_its_end():
    ev = at([5, 9, 10, 10, 15, 20, 21, 30, 31])
    # the first frame also has those at its beginning
    assert frames.frame_bounds(ev, 10, np.array([0, 10, 20])).tolist() == [2, 6, 8]
    assert frames.frame_bounds(ev, 0, np.array([0, 9, 10])).tolist() == [0, 2, 4]


def slow_bounds(t, starts):
    """The first event at or after each frame's start, and the number of events."""
    return [sum(time < start for time in t) for start in starts] + [len(t)]


def random_events(seed):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(-20, 40, rng.integers(0, 30)))
    start, end = (int(t[0]), int(t[-1])) if t.size else (3, 3)
    return at(t, start=start - int(rng.integers(0, 4)), end=end + int(rng.integers(0, 4)))


@pytest.mark.parametrize("seed", range(8))
def test_bounds_are_those_of_a_slow_loop(seed):
    ev = random_events(seed)
    t, length = ev.t.tolist(), ev.end - ev.start
    for count in (1, 2, 3, 7, 40):
        # a frame's events by the definition: floor(count (t - start) / (end - start)), the end's in the last
        frame = [min(count * (time - ev.start) // max(length, 1), count - 1) for time in t]
        assert np.diff(frames.equal_bounds(ev, count)).tolist() == [frame.count(n) for n in range(count)]
        groups = [t[n : n + count] for n in range(0, len(t), count)] or [[]]
        assert np.diff(frames.count_bounds(ev, count)).tolist() == [len(group) for group in groups]
        starts = list(range(ev.start, max(ev.end, ev.start + 1), count))
        assert frames.duration_bounds(ev, count).tolist() == slow_bounds(t, starts)
    shares = [(0, 1), (1, 3), (1, 2), (9, 10)]
    starts = [ev.start + Fraction(a, b) * max(length, 1) for a, b in shares]
    assert frames.fraction_bounds(ev, ev.start, ev.end, shares).tolist() == slow_bounds(t, starts)


def test_events_at_one_time_are_in_the_first_frame():
    for ev, size in ((at([5, 5]), 2), (at([]), 0)):
        assert frames.equal_bounds(ev, 3).tolist() == [0, size, size, size]
        assert frames.duration_bounds(ev, 3).tolist() == [0, size]
        assert frames.count_bounds(ev, 3).tolist() == [0, size]


def test_times_too_large_for_floating_point():
    ev = at(2**60 + np.arange(10), end=2**60 + 10)
    assert frames.equal_bounds(ev, 10).tolist() == list(range(11))


def test_frames_longer_than_time_itself():
    ev = at([-LATEST + 1, 0, LATEST - 1])
    assert frames.duration_bounds(ev, 10**30).tolist() == [0, 3]
    assert frames.duration_bounds(ev, LATEST).tolist() == [0, 2, 3]
    assert frames.equal_bounds(ev, 2).tolist() == [0, 1, 3]
    assert frames.equal_bounds(ev, 3).tolist() == [0, 1, 2, 3]
