"""What real sensors add: rates and rules, checked on events of known frames."""

import numpy as np
import pytest

from nvsdata.emulation import PIX2NVS

SIZE = (40, 30)


def still(length=26, value=100):
    return [np.full(SIZE[::-1], value, np.uint8)] * length


def flicker(length=11):
    return [np.full(SIZE[::-1], 60 if n % 2 else 200, np.uint8) for n in range(length)]


def test_background_activity_has_its_rate():
    events = PIX2NVS(noise_rate=5).emulate(still(), fps=25)
    expected = 5 * SIZE[0] * SIZE[1]  # in a second
    assert abs(len(events) - expected) < 5 * expected**0.5
    assert abs(events.p.mean() - 0.5) < 0.05
    assert len(set(zip(events.x.tolist(), events.y.tolist(), strict=True))) > 0.9 * SIZE[0] * SIZE[1]
    assert (np.diff(events.t) >= 0).all()
    assert events.t[-1] < 1_000_000


def test_hot_pixels_are_few_and_steady():
    events = PIX2NVS(hot_pixels=0.01, hot_rate=50).emulate(still(), fps=25)
    pixels = set(zip(events.x.tolist(), events.y.tolist(), strict=True))
    assert len(pixels) == 12
    assert (events.p == 1).all()
    assert abs(len(events) - 600) < 5 * 600**0.5


def test_a_refractory_pixel_is_blind():
    settings = PIX2NVS(max_events=3, timestamps="interpolated")
    events = settings.emulate(flicker(), fps=25)
    tired = PIX2NVS(max_events=3, refractory=30_000).emulate(flicker(), fps=25)
    assert 0 < len(tired) < len(events)
    for x, y in ((0, 0), (7, 9)):
        assert np.diff(tired.t[(tired.x == x) & (tired.y == y)]).min() >= 30_000
    # what is kept is what the rule keeps of the ideal events
    t = events.t[(events.x == 3) & (events.y == 3)]
    kept, last = [], -(10**9)
    for moment in t.tolist():
        if moment - last >= 30_000:
            kept.append(moment)
            last = moment
    assert tired.t[(tired.x == 3) & (tired.y == 3)].tolist() == kept


def test_a_narrow_readout_lets_no_more_through():
    slow = PIX2NVS(bandwidth=10_000).emulate(flicker(), fps=25)
    ideal = PIX2NVS().emulate(flicker(), fps=25)
    assert 0 < len(slow) < len(ideal)
    assert (np.diff(slow.t) >= 0).all()
    for start in range(0, 400_000, 50_000):
        assert len(slow.window(start, start + 50_000)) <= 10_000 * 0.05 + 1
    wide = PIX2NVS(bandwidth=1e9).emulate(flicker(), fps=25)
    assert len(wide) == len(ideal)
    assert np.abs(wide.t - ideal.t).max() <= 3  # 1,200 events at once pass in 1.2 µs


def test_thresholds_that_differ_scatter_the_events():
    frames = [np.full((60, 80), v, np.uint8) for v in (100, 123)]  # ln 1.23 = 0.207
    assert len(PIX2NVS().emulate(frames)) == 4800
    events = PIX2NVS(mismatch=0.1).emulate(frames)
    assert 0.5 < len(events) / 4800 < 0.75  # a share of Phi(0.35) = 0.64 has a threshold below 0.207
    assert len(np.unique(events.t)) > 100


@pytest.mark.parametrize("flaw", [{"noise_rate": 3}, {"hot_pixels": 0.1}, {"mismatch": 0.2}, {"timestamps": "random"}])
def test_seeds_repeat(flaw):
    assert PIX2NVS(**flaw).emulate(flicker()) == PIX2NVS(**flaw).emulate(flicker())
    assert PIX2NVS(**flaw).emulate(flicker()) != PIX2NVS(**flaw, seed=1).emulate(flicker())
