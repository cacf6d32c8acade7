"""What the search for near events touches: what is near, not all pairs. For builds that check indexes, which count."""

import numpy as np
import pytest

from nvsdata.kernels import _native
from nvsdata.kernels.graph.neighbors import SWEEP, near_edges

pytestmark = pytest.mark.skipif(not _native.checks_bounds, reason="only a build that checks indexes counts them")

ALPHA, BETA = 1.0, (0.5e-5) ** 2
K, RADIUS = 8, 3.0
FEW, MANY = 240, 800
STEP = 14  # of one more event's source: in lists of pixels, of events, of sources and of edges


def searched(events, radius=RADIUS, k=K, beta=BETA, sweep=0):
    """Elements that the search for the edges to some events touches."""
    _native.touched()
    near_edges(*events, radius, ALPHA, beta, k, sweep)
    return _native.touched()


def scattered(n, width=1280, height=720, every=100):
    """Events anywhere on a sensor."""
    rng = np.random.default_rng(0)
    return np.arange(n) * every, rng.integers(0, width, n).astype(np.int16), rng.integers(0, height, n).astype(np.int16)


def circle(n, every=10):
    """Events that go around a circle of 151 pixels again and again."""
    angle = 2 * np.pi * np.arange(n) / 151
    x, y = 60 + 40 * np.cos(angle), 60 + 40 * np.sin(angle)
    return np.arange(n) * every, x.astype(np.int16), y.astype(np.int16)


def one_pixel(n):
    return np.arange(n) * 10, np.full(n, 5, np.int16), np.full(n, 5, np.int16)


def square(n, side=12):
    """Events on all pixels of a square."""
    at = np.random.default_rng(0).permutation(n) % side**2
    return np.arange(n) * 10, (at % side).astype(np.int16), (at // side).astype(np.int16)


def slow_circle(n):
    return circle(n, 1000)


@pytest.mark.parametrize(
    ("events", "n", "settings"),
    [
        (scattered, FEW, {}),
        (scattered, FEW, {"radius": np.inf, "beta": 0.0}),
        (circle, MANY, {}),
        (circle, MANY, {"radius": np.inf, "beta": 0.0}),
        (one_pixel, MANY, {}),
        (slow_circle, MANY, {"beta": 1e-6, "k": 64, "sweep": 48}),
        (slow_circle, MANY, {"beta": 1e-6}),
    ],
)
def test_twice_as_many_events_cost_about_twice_as_much(events, n, settings):
    # all pairs would cost four times as much
    assert searched(events(2 * n), **settings) <= 2.4 * searched(events(n), **settings)


def test_few_events_look_at_the_pixels_within_the_radius_only():
    few = searched(scattered(FEW))
    # the pixels of a few rows, of which bisection finds those that are near
    assert few <= 100 * FEW
    assert searched(scattered(FEW, 5120, 2880)) <= 1.02 * few


@pytest.mark.parametrize(
    ("events", "radius", "beta"), [(circle, 3.0, BETA), (circle, np.inf, 0.0), (one_pixel, 3.0, BETA)]
)
def test_one_more_event_of_a_pixel_costs_as_much_as_its_sources(events, radius, beta):
    # however many events there are already
    for n in (MANY, 4 * MANY):
        more = searched(events(n + MANY), radius, beta=beta) - searched(events(n), radius, beta=beta)
        assert more <= MANY * STEP * (K + 1)


def test_few_sources_cost_less():
    few, many = searched(square(MANY), k=2), searched(square(MANY), k=16)
    assert many - few >= (16 - 2) * MANY * 3
    assert few <= many / 3


@pytest.mark.parametrize("n", [200, MANY])
def test_where_few_are_near_in_time_each_near_pair_is_compared_once(n):
    t, x, y = slow_circle(n)
    i, j = np.triu_indices(n, 1)
    dx, dy, dt = (c[i].astype(int) - c[j] for c in (x, y, t))
    in_time = -dt <= RADIUS / 1e-3 + 1
    near = dx**2 + dy**2 + 1e-6 * dt**2 <= RADIUS**2
    touched = searched((t, x, y), beta=1e-6, k=64, sweep=48)
    # of a pair in time a place, and where it is listed; of a near one both coordinates and times, and two lists
    assert touched <= 2 * in_time.sum() + 40 * near.sum() + 30 * n


def test_the_way_depends_on_the_events_near_in_time():
    """On average 100 earlier ones: pixels are searched, unless differences in time change the order of distances."""
    ways = (0, SWEEP, 10**12)
    pixels, chosen, _ = (searched(scattered(200, every=10), beta=1e-10, sweep=way) for way in ways)
    assert chosen == pixels
    pixels, chosen, sweep = (searched(scattered(MANY, every=10), beta=9e-6, sweep=way) for way in ways)
    assert chosen == sweep != pixels
