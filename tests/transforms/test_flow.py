"""Flow against plane fits of NumPy, and on edges of known velocity."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import moving_edge, moving_square

import nvsdata
from nvsdata import Events
from nvsdata import transforms as T


def slow(events, radius=2, window=50_000, tolerance=2_000, least=6):
    latest, found = {}, np.zeros((len(events), 3))
    for i, (t, x, y, p) in enumerate(zip(*(column.tolist() for column in events.columns), strict=True)):
        latest[p, x, y] = t
        near = [
            (dx, dy, latest[p, x + dx, y + dy] - t)
            for dy in range(-radius, radius + 1)
            for dx in range(-radius, radius + 1)
            if latest.get((p, x + dx, y + dy), t - window - 1) >= t - window
        ]
        found[i] = velocity(np.array(near, float), tolerance, least)
    return found


def velocity(near, tolerance, least):
    while len(near) >= least:
        design = np.column_stack((near[:, :2], np.ones(len(near))))
        if np.linalg.matrix_rank(design) < 3:
            break
        plane = np.linalg.lstsq(design, near[:, 2], rcond=None)[0]
        good = abs(design @ plane - near[:, 2]) <= tolerance
        if good.all():
            gradient = plane[:2] / 1e6
            steep = np.hypot(*gradient)
            if abs(plane[2]) > tolerance or steep < 1e-6:
                break
            return (*gradient / steep**2, 1)
        near = near[good]
    return 0, 0, 0


# no time differs from a plane by exactly these tolerances
SETTINGS = (
    {"tolerance": 1_999.37},
    {"radius": 1, "least": 3, "tolerance": 1_777.31},
    {"radius": 3, "window": 30_000, "tolerance": 3_333.17, "least": 9},
)


def compare(events, chosen):
    found, expected = T.PlaneFlow(**chosen)(events).numpy(), slow(events, **chosen)
    assert np.array_equal(found[:, 2], expected[:, 2])
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-3)
    return found


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), chosen=st.sampled_from(SETTINGS), origin=st.sampled_from((0, -(2**61), 2**61)))
def test_random_events(seed, chosen, origin):
    rng = np.random.default_rng(seed)
    t = origin + np.cumsum(rng.choice([0, 3, 211], 200))
    events = Events(t, rng.integers(0, 9, 200), rng.integers(0, 7, 200), rng.integers(0, 2, 200), (9, 7))
    compare(events, chosen)


@pytest.mark.parametrize("chosen", SETTINGS)
def test_example_recording(chosen):
    found = compare(nvsdata.example()[30_000:30_800], chosen)
    assert 0.05 < found[:, 2].mean() < 1


@pytest.mark.parametrize("chosen", SETTINGS)
def test_a_real_recording(real_nmnist, chosen):
    found = compare(nvsdata.read(min(real_nmnist.glob("Train/*/*.bin")))[:1_500], chosen)
    assert 0.05 < found[:, 2].mean() < 1


@pytest.mark.parametrize("speed", [30.0, 400.0, 20_000.0])
@pytest.mark.parametrize("degrees", range(0, 360, 40))
def test_an_edge_has_its_velocity(speed, degrees):
    true = speed * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    found = T.PlaneFlow(window=200_000)(moving_edge(true)).numpy()
    valid = found[:, 2] == 1
    assert valid.mean() > 0.9
    np.testing.assert_allclose(found[valid, :2], np.tile(true, (valid.sum(), 1)), atol=0.03 * speed)


def test_a_square_has_the_normal_velocity_of_its_sides():
    events = moving_square((300.0, 0.0), 10.0, 0.4, (20.0, 25.0))
    found = T.PlaneFlow()(events)[events.t > 30_000]
    vx, vy = found[found[:, 2] == 1, :2].double().T
    # the side's normal is at 0.4 or at 0.4 - pi / 2
    sides = torch.tensor([[np.cos(a), np.sin(a)] for a in (0.4, 0.4 - np.pi / 2)])
    expected = 300 * sides[:, :1] * sides
    distance = torch.stack([torch.hypot(vx - ex, vy - ey) for ex, ey in expected])
    assert distance.min(0).values.median() < 15
    assert {*distance.argmin(0).tolist()} == {0, 1}


def test_outliers_are_left_out():
    edge = moving_edge((400.0, 0.0))
    t = edge.t.copy()
    # one old event near the pixel (10, 10)
    t[(edge.x == 8) & (edge.y == 8)] -= 20_000
    events = Events(t, edge.x, edge.y, edge.p, edge.sensor_size)
    at = (events.x == 10) & (events.y == 10)
    assert T.PlaneFlow()(events)[at].tolist() == [[pytest.approx(400), pytest.approx(0, abs=1e-3), 1]]
    assert T.PlaneFlow(tolerance=1e9)(events)[at][0, 0] != pytest.approx(400, rel=0.03)


def test_polarities_have_separate_surfaces():
    edge = moving_edge((400.0, 0.0))
    mixed = Events(edge.t, edge.x, edge.y, np.zeros(len(edge)) + (edge.x % 2 == 0), edge.sensor_size)
    # a column every second pixel, so neighborhoods of 3 pixels have one column
    assert T.PlaneFlow(radius=1, least=3)(edge)[:, 2].any()
    assert not T.PlaneFlow(radius=1, least=3)(mixed)[:, 2].any()


@pytest.mark.parametrize(
    "columns",
    [
        ([], [], [], []),
        ([0, 10], [1, 2], [1, 1], [1, 1]),
        (range(0, 9_000, 1_000), range(9), range(9), [1] * 9),
        ([5] * 9, [0, 1, 2] * 3, [0] * 3 + [1] * 3 + [2] * 3, [0] * 9),
    ],
    ids=["none", "few", "on a line", "at once"],
)
def test_events_without_a_plane(columns):
    found = T.PlaneFlow(least=3)(Events(*map(list, columns), (9, 9)))
    assert found.shape == (len(columns[0]), 3)
    assert found.dtype == torch.float32
    assert not found.any()


def test_bad_settings_are_refused():
    for bad in (0, 9, 1.5, float("nan")):
        with pytest.raises(ValueError, match="radius must be"):
            T.PlaneFlow(radius=bad)
    for bad in (0, -1, float("inf"), float("nan")):
        with pytest.raises(ValueError, match="tolerance must be positive"):
            T.PlaneFlow(tolerance=bad)
        with pytest.raises(ValueError, match="window"):
            T.PlaneFlow(window=bad)
    for bad in (2, 3.5, float("inf")):
        with pytest.raises(ValueError, match="least must be a whole number of at least 3"):
            T.PlaneFlow(least=bad)
