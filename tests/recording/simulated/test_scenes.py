"""What a simulated camera sees of a screen."""

from dataclasses import replace

import numpy as np
import pytest

from nvsdata.recording.davis.registers import CHIPS
from nvsdata.recording.simulated.scenes import PIXELS, Watched

GRAY = np.full((60, 80, 3), 120, np.uint8)


@pytest.mark.parametrize("rate", [0.0, 2.0])
def test_a_still_screen_gives_noise_alone(rate):
    scene = Watched(pixels=replace(PIXELS, noise_rate=rate, hot_pixels=0.0, mismatch=0.0))
    scene.look(0, GRAY)
    scene.events(0, 200_000)
    found = scene.events(200_000, 1_200_000)
    expected = rate * 240 * 180
    assert abs(len(found) - expected) <= 5 * np.sqrt(expected)


def test_a_change_of_the_screen_is_seen():
    scene = Watched(pixels=replace(PIXELS, noise_rate=0.0, hot_pixels=0.0))
    scene.look(0, GRAY // 4)
    scene.events(0, 200_000)
    scene.look(300_000, GRAY)
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
