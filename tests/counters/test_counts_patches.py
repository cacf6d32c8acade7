"""What patches and merged pixels of events take: their pixels, however large the sensor.

Run as a script by the fixture `counts`, without compiled kernels, so that arrays can count what is read and written.
"""

import json

import numpy as np
import pytest
from counting_work import flat, touches, uncompiled

FEW, MANY = 60, 200


def as_python():
    """Put what Python understands in the place of an instruction of numba's own."""
    from nvsdata.kernels import bits, pixels

    for module in (bits, pixels):
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


def patches(n, width):
    from nvsdata.kernels import patches as kernels
    from nvsdata.kernels import pixels

    _, x, y = scattered(n, width, width)
    with touches(kernels, pixels) as tally:
        kernels.patch_counts(x, y, x % 2, np.stack((x, y), 1).astype(np.float32)[:20], 5)
    return flat(tally)


def merged(events):
    from nvsdata.kernels import patches as kernels
    from nvsdata.kernels import pixels

    with touches(kernels, pixels) as tally:
        kernels.merged_pixels(*events, events[1] % 2)
    return flat(tally)


def work():
    """All counts, by scenario."""
    as_python()
    return {
        "patches": patches(FEW, 100),
        "patches of a larger sensor": patches(FEW, 800),
        "merged": merged(circle(MANY)),
        "merged twice": merged(circle(2 * MANY)),
    }


@pytest.fixture(scope="module")
def counts():
    return uncompiled(__file__)


def test_twice_as_many_events_cost_about_twice_as_much(counts):
    assert counts["merged twice"]["touched"] <= 2.1 * counts["merged"]["touched"]


def test_patches_cost_as_much_as_their_pixels_however_large_the_sensor(counts):
    small, large = counts["patches"], counts["patches of a larger sensor"]
    # 20 patches of 25 pixels; a tile and a number for each, and 14 for each event that is grouped by pixel
    assert max(small["touched"], large["touched"]) <= 20 * 25 * 4 + FEW * 30
    assert abs(large["touched"] - small["touched"]) <= 0.05 * small["touched"]


if __name__ == "__main__":
    np.seterr(all="ignore")
    print(json.dumps(work()))
