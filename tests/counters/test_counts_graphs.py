"""What the search for near events looks at: what is near, not all pairs.

Run as a script by the fixture `counts`, without compiled kernels, so that arrays can count what is read and written.
"""

import json

import numpy as np
import pytest
from counting_work import flat, touches, uncompiled

ALPHA, BETA = 1.0, (0.5e-5) ** 2
K, RADIUS = 8, 3.0
NEAR = 29  # pixels within the radius
FEW = 60
MANY = 200
STEP = 12  # reads and writes for one of an event's sources: in lists of pixels, of events, of sources and of edges


def searched(events, radius=RADIUS, k=K, beta=BETA, sweep=0):
    """What the search takes for the edges to some events."""
    from nvsdata.kernels import neighbors, pixels, rings
    from nvsdata.kernels import sweep as sweeping

    with touches(neighbors, pixels, rings, sweeping, calls=("_distance",)) as tally:
        edges = neighbors.near_edges(*events, radius, ALPHA, beta, k, sweep)
    return flat(tally) | {"edges": edges.shape[1]}


def as_python():
    """Put what Python understands in the place of an instruction of numba's own."""
    from nvsdata.kernels import bits, pixels, rings

    for module in (bits, pixels, rings):
        module.trailing_zeros = lambda word: np.uint64((int(word) & -int(word)).bit_length() - 1)


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


def patches(n, width):
    from nvsdata.kernels import pixels
    from nvsdata.kernels.represent import patches as kernels

    _, x, y = scattered(n, width, width)
    with touches(kernels, pixels) as tally:
        kernels.patch_counts(x, y, x % 2, np.stack((x, y), 1).astype(np.float32)[:20], 5)
    return flat(tally)


def merged(events):
    from nvsdata.kernels import pixels
    from nvsdata.kernels.represent import patches as kernels

    with touches(kernels, pixels) as tally:
        kernels.merged_pixels(*events, events[1] % 2)
    return flat(tally)


def work():
    """All counts, by scenario."""
    as_python()
    wide = scattered(FEW, 5120, 2880)
    return {
        "few": searched(scattered(FEW)),
        "twice few": searched(scattered(2 * FEW)),
        "few on a larger sensor": searched(wide),
        "nearest of few": searched(scattered(FEW), np.inf, beta=0.0),
        "circle": searched(circle(MANY)),
        "twice around": searched(circle(2 * MANY)),
        "nearest on a circle": searched(circle(MANY), np.inf, beta=0.0),
        "nearest twice around": searched(circle(2 * MANY), np.inf, beta=0.0),
        "pixel": searched(one_pixel(MANY)),
        "pixel twice": searched(one_pixel(2 * MANY)),
        "dense, 2": searched(square(MANY), k=2),
        "dense, 16": searched(square(MANY), k=16),
        "slow": searched(circle(MANY, 1000), beta=1e-6, k=64, sweep=48),
        "slow, twice": searched(circle(2 * MANY, 1000), beta=1e-6, k=64, sweep=48),
        "slow, by pixel": searched(circle(MANY, 1000), beta=1e-6),
        "slow, by pixel, twice": searched(circle(2 * MANY, 1000), beta=1e-6),
    }


@pytest.fixture(scope="module")
def counts():
    return uncompiled(__file__)


@pytest.mark.parametrize(
    ("once", "twice"),
    [
        ("few", "twice few"),
        ("circle", "twice around"),
        ("nearest on a circle", "nearest twice around"),
        ("pixel", "pixel twice"),
        ("slow", "slow, twice"),
        ("slow, by pixel", "slow, by pixel, twice"),
    ],
)
def test_twice_as_many_events_cost_about_twice_as_much(counts, once, twice):
    # all pairs would cost four times as much
    assert counts[twice]["touched"] <= 2.1 * counts[once]["touched"]


def test_few_events_look_at_the_pixels_within_the_radius_only(counts):
    for name, n in (("few", FEW), ("twice few", 2 * FEW), ("few on a larger sensor", FEW)):
        # an offset's two numbers, a tile, a pixel's number in it; and rows of pixels that are written
        assert counts[name]["pixels read"] <= n * (NEAR * 4 + 60)
        assert counts[name]["touched"] <= n * (NEAR * 6 + 100)
    assert counts["few on a larger sensor"]["touched"] <= 1.02 * counts["few"]["touched"]


def test_neighbors_of_few_events_are_searched_up_to_the_furthest_of_them_only(counts):
    _, x, y = scattered(FEW)
    dx, dy = np.subtract.outer(x.astype(int), x), np.subtract.outer(y.astype(int), y)
    far = np.sort(np.hypot(dx, dy), 1)[:, K]
    # squares of tiles of 8 pixels that hold the circle of that distance, and one more on either side
    tiles = ((2 * (np.ceil(far / 8) + 1) + 1) ** 2).sum()
    listed = 197 * 5  # offsets within 8 pixels
    assert counts["nearest of few"]["pixels read"] <= tiles + FEW * (listed + 64 * FEW)


@pytest.mark.parametrize(
    ("once", "twice"),
    [("circle", "twice around"), ("nearest on a circle", "nearest twice around"), ("pixel", "pixel twice")],
)
def test_one_more_event_of_a_pixel_costs_as_much_as_its_sources(counts, once, twice):
    # however many events there are already
    assert counts[twice]["touched"] - counts[once]["touched"] <= MANY * STEP * (K + 1)


def test_few_sources_cost_less(counts):
    few, many = counts["dense, 2"], counts["dense, 16"]
    assert many["touched"] - few["touched"] >= (16 - 2) * MANY * 3
    assert few["touched"] <= many["touched"] / 2
    assert few["neighbors made"] <= many["neighbors made"] / 4


def test_where_few_are_near_in_time_each_near_pair_is_compared_once(counts):
    for name, n in (("slow", MANY), ("slow, twice", 2 * MANY)):
        t, x, y = circle(n, 1000)
        i, j = np.triu_indices(n, 1)
        dx, dy, dt = (c[i].astype(int) - c[j] for c in (x, y, t))
        in_time = -dt <= RADIUS / 1e-3 + 1
        # in a box with a power of two as its side, that begins a pixel before the radius does
        boxed = in_time & (dx >= -4) & (dx < 12) & (dy >= -4) & (dy < 12)
        near = dx**2 + dy**2 + 1e-6 * dt**2 <= RADIUS**2
        assert counts[name]["edges"] == 2 * near.sum()
        assert counts[name]["_distance"] == boxed.sum()
        assert counts[name]["sweep read"] <= 2 * in_time.sum() + 3 * boxed.sum() + 8 * n


if __name__ == "__main__":
    np.seterr(all="ignore")
    print(json.dumps(work()))
