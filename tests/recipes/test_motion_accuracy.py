"""The recipe on the accuracy of flow and corners, at one speed and in few directions."""

import runpy

import numpy as np
import pytest
from places import RECIPES

from nvsdata import transforms as T
from nvsdata.emulation import DVS


@pytest.fixture(scope="module")
def recipe():
    return runpy.run_path(str(RECIPES / "motion_accuracy.py"))


@pytest.fixture(scope="module")
def pair(recipe):
    scene = recipe["Scene"](recipe["polygon"](4, 30, 0.4, 200), np.array([800.0, 300.0]))
    return scene, DVS().emulate(scene.frames(), fps=recipe["FPS"])


def test_flow_is_accurate_on_first_events(recipe, pair):
    scene, events = pair
    angle, speed, valid = recipe["flow_errors"](scene, T.RefractoryPeriod(20_000)(events))
    assert len(angle) > 1_000
    assert np.median(angle) < 1
    assert np.median(speed) < 0.02
    assert valid.mean() > 0.9


def test_corner_events_are_at_corners(recipe, pair):
    events, near, kept, right, steps, found = recipe["corner_counts"](*pair)
    assert right / kept > 0.8 > 0.3 > near / events
    assert found / steps > 0.7
    assert 0 < kept < 0.1 * events
    assert found <= steps


def test_the_truth_is_the_motion_of_the_outline(recipe, pair):
    scene, events = pair
    truth, compared = scene.true_flow(events)
    x, y = np.stack((events.x, events.y)) - scene.center(events.t)
    # events are where the outline was drawn
    assert np.abs(scene.shape.outside(x, y).max(0)).max() < 2
    direction = truth[compared] / np.hypot(*truth[compared].T)[:, None]
    np.testing.assert_allclose(np.hypot(*truth[compared].T), np.abs(direction @ scene.velocity), rtol=1e-9)
