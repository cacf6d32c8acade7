"""Corners against the definition of eFAST, and on a square whose corners are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import moving_square, square_center

import nvsdata
from nvsdata import Events
from nvsdata import transforms as T


def circle(*eighth):
    """The pixels of a circle in order, from a quarter of it."""
    return [turned for k in range(4) for x, y in eighth for turned in [((x, y), (-y, x), (-x, -y), (y, -x))[k]]]


RINGS = (
    (circle((3, 0), (3, 1), (2, 2), (1, 3)), range(3, 7)),
    (circle((4, 0), (4, 1), (3, 2), (2, 3), (1, 4)), range(4, 9)),
)


def has_arc(times, lengths):
    """True if every time of some arc is newer than all others of the circle."""
    for length in lengths:
        for start in range(len(times)):
            around = times[start:] + times[:start]
            if min(around[:length]) > max(around[length:]):
                return True
    return False


def slow(events):
    width, height = events.sensor_size
    latest, kept = {}, []
    for i, (t, x, y, p) in enumerate(zip(*(column.tolist() for column in events.columns), strict=True)):
        latest[p, x, y] = t
        if 4 <= x < width - 4 and 4 <= y < height - 4:
            rings = ([latest.get((p, x + dx, y + dy), -(2**63)) for dx, dy in ring] for ring, _ in RINGS)
            if all(has_arc(times, lengths) for times, (_, lengths) in zip(rings, RINGS, strict=True)):
                kept.append(i)
    return events.of(events.columns.take(np.array(kept, int)))


def test_circles_have_the_published_pixels():
    assert [len(set(ring)) for ring, _ in RINGS] == [16, 20]
    for ring, _ in RINGS:
        steps = np.abs(np.diff([*ring, ring[0]], axis=0))
        assert steps.max() == 1


@pytest.mark.parametrize("polarity", [0, 1])
@pytest.mark.parametrize("inner", range(1, 9))
def test_arcs_of_each_length(inner, polarity):
    """An arc of equally new pixels on an old circle, anywhere on it."""
    for outer in range(2, 11):
        for start in range(0, 20, 3):
            columns = []
            for (ring, _), length in zip(RINGS, (inner, outer), strict=True):
                turned = ring[start % len(ring) :] + ring[: start % len(ring)]
                columns += [(100 if k < length else k % 3, 6 + x, 5 + y, polarity) for k, (x, y) in enumerate(turned)]
            # the other polarity has its own surface
            columns += [(150, 6 + x, 5 + y, 1 - polarity) for ring, _ in RINGS for x, y in ring]
            center = (200, 6, 5, polarity)
            events = Events(*zip(*columns, center, strict=True), (13, 11))
            found = T.Corners()(events)
            assert (200 in found.t) == (3 <= inner <= 6 and 4 <= outer <= 8)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), noise=st.integers(0, 300), size=st.integers(1, 90))
def test_random_events_and_streams(seed, noise, size):
    rng = np.random.default_rng(seed)
    square = moving_square(rng.uniform(-300, 300, 2), 5.0, rng.uniform(0, 3), (13, 12), 20_000, (26, 24), 200)
    t, at = rng.integers(0, 20_000, noise), rng.integers(0, 24, (2, noise))
    both = zip(square.columns, (t, *at, rng.integers(0, 2, noise)), strict=True)
    events = Events(*(np.concatenate(pair) for pair in both), (26, 24))
    found = T.Corners()(events)
    assert found == slow(events)
    sieve = T.Corners().begin((26, 24))
    pieces = [sieve(events[at : at + size]) for at in range(0, len(events), size)]
    assert sum(map(len, pieces)) == len(found)


def test_example_recording():
    events = T.Crop(30, 80, 60, 50)(nvsdata.example())[:5_000]
    found = T.Corners()(events)
    assert len(found) > 50
    assert found == slow(events)


def test_a_real_recording(real_nmnist):
    events = nvsdata.read(min(real_nmnist.glob("Train/*/*.bin")))
    found = T.Corners()(events)
    assert len(found) > 20
    assert found == slow(events)


@pytest.mark.parametrize("turn", [0.3, 0.7, 1.2])
@pytest.mark.parametrize("velocity", [(300.0, 100.0), (-50.0, 280.0)])
def test_corners_of_a_square_are_found(velocity, turn):
    begin = 30 - 0.03 * velocity[0], 25 - 0.03 * velocity[1]
    events = moving_square(velocity, 10.0, turn, begin)
    found = T.Corners()(events)
    found = found[found.t > 20_000]
    angles = turn + np.pi / 4 + np.pi / 2 * np.arange(4)
    x, y = np.stack((found.x, found.y)) - square_center(found.t, velocity, begin)
    radius = 10 * np.sqrt(2)
    distance = np.hypot(x[:, None] - radius * np.cos(angles), y[:, None] - radius * np.sin(angles))
    assert (distance.min(1) <= 3).mean() > 0.8
    ahead = np.cos(angles - np.arctan2(*velocity[::-1]))
    for corner in range(4):
        periods = np.unique(found.t[distance[:, corner] <= 3] // 10_000).size
        # around the rear corner, most of the circle is new
        assert periods >= 3 if ahead[corner] > -0.8 else periods == 0


def test_straight_edges_and_borders_have_no_corners():
    y, x = (axis.ravel() for axis in np.mgrid[:20, :30])
    events = Events(1_000 * x, x, y, np.ones(x.size), (30, 20))
    kept = T.Corners()(events)
    # the edge ends at the border
    assert len(kept) < 0.02 * len(events)
    small = Events([0], [3], [3], [1], (7, 7))
    assert len(T.Corners()(small)) == 0
