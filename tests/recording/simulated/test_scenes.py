"""What a simulated camera sees of a screen."""

from dataclasses import replace

import numpy as np
import pytest

from nvsdata.recording.davis.registers import CHIPS
from nvsdata.recording.simulated.scenes import PIXELS, Outlines, Watched

GRAY = np.full((60, 80, 3), 120, np.uint8)


@pytest.mark.parametrize("rate", [0.0, 2.0])
def test_a_still_screen_gives_noise_alone(rate):
    scene = Watched(pixels=replace(PIXELS, noise_rate=rate, hot_pixels=0.0, mismatch=0.0))
    scene.show(0, GRAY)
    scene.events(0, 200_000)
    found = scene.events(200_000, 1_200_000)
    expected = rate * 240 * 180
    assert abs(len(found) - expected) <= 5 * np.sqrt(expected)


def test_a_change_of_the_screen_is_seen():
    scene = Watched(pixels=replace(PIXELS, noise_rate=0.0, hot_pixels=0.0))
    scene.show(0, GRAY // 4)
    scene.events(0, 200_000)
    scene.show(300_000, GRAY)
    found = scene.events(200_000, 600_000)
    # where the screen is, from top to bottom, after it began to change
    assert len(found) > 10_000
    assert found.p.mean() > 0.95
    assert found.t[0] >= 300_000
    upper, lower = (found.t[rows].mean() for rows in (found.y < 70, found.y > 110))
    assert 2_000 < lower - upper < 12_000


def test_the_chips_that_cameras_name():
    # the register that holds the number is read from the camera; the numbers are the vendor's
    assert CHIPS == {
        0: "DAVIS240A",
        1: "DAVIS240B",
        2: "DAVIS240C",
        3: "DAVIS128",
        4: "DAVIS346A",
        5: "DAVIS346B",
        6: "DAVIS640",
        7: "DAVIS640H",
        8: "DAVIS208",
        9: "DAVIS346C",
    }


def test_outlines_lie_on_a_square_that_circles():
    start = 700_000
    events = Outlines(rate=100_000, noise=0).events(start, start + 400_000)
    assert len(events) == pytest.approx(40_000, abs=1_000)
    assert start <= events.t[0] < start + 1_000
    assert start + 399_000 < events.t[-1] < start + 400_000
    angle = events.t / 1e6 * np.pi
    # the place within the square, to the pixel that it is cut down to
    x, y = events.x - (90 + 60 * np.cos(angle)), events.y - (60 + 45 * np.sin(angle))
    assert -1 <= x.min() < x.max() <= 60
    assert -1 <= y.min() < y.max() <= 60
    first, last = (x < 0.01) | (y < 0.01), (x > 58.99) | (y > 58.99)
    # ON at the right and below, OFF at the left and above, all sides alike
    assert last[events.p == 1].all()
    assert first[events.p == 0].all()
    for side in (x <= 0, y <= 0, x >= 59, y >= 59):
        assert side.mean() == pytest.approx(0.25, abs=0.03)
    for along, other in ((x, y), (y, x)):
        inside = along[(other <= 0) & (along > 0)]
        assert inside.mean() == pytest.approx(30, abs=1.5)


def test_noise_is_anywhere():
    events = Outlines(rate=0, noise=100_000).events(0, 400_000)
    assert len(events) == pytest.approx(40_000, abs=1_000)
    counts = np.histogram2d(events.x, events.y, [8, 6], [(0, 240), (0, 180)])[0]
    assert counts.min() > 650
    assert (events.x.min(), events.x.max(), events.y.min(), events.y.max()) == (0, 239, 0, 179)
    mixed = Outlines(rate=100_000, noise=25_000).events(0, 400_000)
    assert len(mixed) == pytest.approx(50_000, abs=1_200)
    # the square is nowhere near that corner
    assert ((mixed.x < 80) & (mixed.y > 165) | (mixed.x < 25)).sum() > 500
    assert len(Outlines().events(5, 5)) == 0
    assert Outlines().pulses(0, 10**9) == []
    assert (Outlines().rate, Outlines().noise) == (200_000, 20_000)


def test_a_pulse_is_given_once_in_the_time_that_it_belongs_to():
    scene = Watched()
    scene._pulses = [100, 200, 250, 300]
    assert scene.pulses(0, 200) == [100]
    assert scene.pulses(200, 250) == [200]
    # too late for one
    assert scene.pulses(260, 301) == [300]
    assert scene.pulses(0, 10**9) == []
