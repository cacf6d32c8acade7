"""Distances and similarities of few and huge numbers, against exact ones."""

import itertools
import math
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
import torch
from scipy.optimize import linear_sum_assignment

from nvsdata import Events, metrics
from nvsdata.kernels.metrics.distances import least_work, nearest_spikes
from nvsdata.models.prediction import vote
from nvsdata.training.evaluation import share_right

EDGE = 32_766  # the last pixel of the largest sensor
MANY = 1_000_000


def spikes(places, signs=None, size=(200, 200)):
    """An event at each place (x, y), all at one time."""
    x, y = np.array(places).reshape(-1, 2).T
    return Events(np.zeros(x.size, int), x, y, np.ones(x.size, int) if signs is None else signs, size)


def test_a_spike_at_exactly_epsilon_is_within_it():
    """Squares of roots are rounded to either side: at 205 of these 899 distances it once was outside."""
    origin = spikes([(0, 0)])
    for x, y in itertools.product(range(30), repeat=2):
        apart = math.sqrt(x * x + y * y)
        other = spikes([(x, y)])
        assert metrics.epsilon_repeatability(origin, other, epsilon=apart).value == 1
        if apart:
            assert metrics.epsilon_repeatability(origin, other, epsilon=math.nextafter(apart, 0)).value == 0


@pytest.mark.parametrize(("x", "y"), [(EDGE, 2), (0, 2), (EDGE, 0), (1, 0)])
def test_distances_from_corner_to_corner(x, y):
    size = (EDGE + 1, 3)
    for here, there in itertools.product(((0, 0), (EDGE, 2)), ((x, y), (EDGE - x, 2 - y))):
        far = math.hypot(here[0] - there[0], here[1] - there[1])
        a, b, off = spikes([here], size=size), spikes([there], size=size), spikes([there], [0], size)
        assert metrics.chamfer(a, b).value == pytest.approx(far, rel=1e-15)
        assert metrics.emd(a, b, blocks=1).value == pytest.approx(far, rel=1e-15)
        # λ² times the square of the difference of +1 and -1
        assert metrics.chamfer(a, off).value == pytest.approx(math.sqrt(far**2 + 12), rel=1e-15)
        assert metrics.epsilon_repeatability(a, b, epsilon=far).value == 1
        assert metrics.epsilon_repeatability(a, off, epsilon=1e300).value == 0


@pytest.mark.long
def test_distances_across_the_largest_sensor():
    size = (EDGE + 1, EDGE + 1)
    a, b = spikes([(0, 0)], size=size), spikes([(EDGE, EDGE)], size=size)
    assert metrics.chamfer(a, b).value == pytest.approx(EDGE * math.sqrt(2), rel=1e-15)
    assert metrics.epsilon_repeatability(a, b, epsilon=EDGE * math.sqrt(2)).value == 1
    assert metrics.emd(a, b, blocks=1).value == pytest.approx(EDGE * math.sqrt(2), rel=1e-15)


def test_a_million_events_of_a_pixel_are_one_heavy_spike():
    size = (100, 3)
    heavy = spikes(np.zeros((MANY, 2), int), size=size)
    off = spikes(np.full((MANY, 2), (99, 2)), np.zeros(MANY, int), size)
    light = spikes([(99, 2)], size=size)
    far = 99**2 + 2**2
    assert metrics.chamfer(heavy, light).value == pytest.approx(math.sqrt(far + 3 * (MANY - 1) ** 2), rel=1e-15)
    assert metrics.chamfer(heavy, off).value == pytest.approx(math.sqrt(far + 3 * (2 * MANY) ** 2), rel=1e-15)
    # a sensor so small that each pixel is looked up
    small = [spikes(np.full((count, 2), (x, 0)), size=(4, 1)) for count, x in ((MANY, 0), (1, 3))]
    for a, b in (small, small[::-1]):
        assert metrics.chamfer(a, b).value == pytest.approx(math.sqrt(3**2 + 3 * (MANY - 1) ** 2), rel=1e-15)
    # of the surplus nothing is moved
    for other in (off, light):
        assert metrics.emd(heavy, other, blocks=1).value == pytest.approx(math.sqrt(far), rel=1e-15)
    assert metrics.compare(heavy, off).counts_apart == pytest.approx((math.log(MANY + 1),) * 2, rel=1e-15)


def test_nothing_is_no_distance_away():
    full, empty = spikes([(1, 1)] * 1000), Events.empty((200, 200))
    for a, b, measure in itertools.product((full, empty), (full, empty), (metrics.chamfer, metrics.emd)):
        if len(a) and len(b):
            assert measure(a, b).value == 0
            continue
        found = measure(a, b)
        assert (math.isnan(found.value), found.used) == (True, 0)
        assert (found.empty_emulated, found.empty_real) == (len(a) == 0, len(b) == 0)
    # of one block only a side is empty
    apart = spikes([(0, 0), (199, 199)]), spikes([(3, 4)])
    assert metrics.emd(*apart, blocks=4).value == 5


@pytest.mark.parametrize("mass", [1, MANY, 2**31 + 1, 2**53 + 1, 2**61])
def test_masses_of_any_size(mass):
    """Masses are whole numbers; only the sum of what they cost is rounded."""
    one, row = np.ones(1), np.array([0.0, 30.0])
    alone = least_work(0 * one, 0 * one, np.array([mass]), 3 * one, 4 * one, np.array([mass]))
    assert alone == pytest.approx(5.0 * mass, rel=1e-15)
    moved = least_work(row, 0 * row, np.array([mass, 1]), row + 7, 0 * row, np.array([mass // 2 + 1, 1]))
    # the unit at 30 goes 7 pixels, as does every unit that the lighter pile has room for
    assert moved == pytest.approx(float(7 * (mass // 2 + 2)), rel=1e-15)
    # the one unit of surplus is the one that is far away
    left = least_work(1000 * row, 0 * row, np.array([mass, 1]), one, 0 * one, np.array([mass]))
    assert left == pytest.approx(float(mass), rel=1e-15)


@pytest.mark.parametrize("reach", [10, 1_000, EDGE + 1])
def test_transport_between_units_is_the_best_assignment(reach):
    for seed in range(8):
        rng = np.random.default_rng(seed)
        a, b = (rng.integers(0, reach, (2, rng.integers(2, 60))).astype(float) for _ in range(2))
        if seed % 2:
            # many ties
            a, b = (np.floor(side * 5 / reach) * (reach // 5) for side in (a, b))
        cost = np.hypot(a[0][:, None] - b[0], a[1][:, None] - b[1])
        exact = math.fsum(cost[linear_sum_assignment(cost)])
        found = least_work(*a, np.ones(a.shape[1], int), *b, np.ones(b.shape[1], int))
        assert found == pytest.approx(exact, rel=1e-14)


def test_weights_so_small_or_large_that_one_part_of_the_distance_vanishes():
    a, b = spikes([(0, 0)] * 5), spikes([(3, 4)])
    assert metrics.chamfer(a, b, weight=0).value == 5
    assert metrics.chamfer(a, b, weight=1e-300).value == 5
    assert metrics.chamfer(a, b, weight=1e150).value == pytest.approx(4e150, rel=1e-15)


def test_scores_that_tie_or_are_nothing_name_a_class_or_none():
    odd = [math.nan, 0.0], [0.0, math.nan], [-math.inf, 0.0], [math.inf, 1.0]
    ties = torch.tensor([[1.0, 1.0], *odd, [3e38, -3e38]])
    # of equals the first
    assert share_right(ties, torch.tensor([0, 0, 0, 1, 0, 0])) == 4 / 6
    assert share_right(ties, torch.tensor([1, 1, 1, 0, 1, 1])) == 0
    named, sure = metrics.predictions(ties)
    assert named.tolist() == [0, -1, -1, 1, -1, 0]
    assert sure.tolist() == [0.5, 0, 0, 1, 0, 1]
    assert metrics.class_accuracies(named, [0] * 6, 3)[0] == 2 / 6
    for scale in (1e-30, 1.0, 1e30, 1e38):
        together = vote(torch.tensor([[0.0, scale], [0.0, scale], [scale / 2, 0.0]]))
        wanted = 1 / (1 + math.exp(-min(scale / 2, 700)))
        assert together.tolist() == pytest.approx([1 - wanted, wanted], rel=1e-6, abs=1e-30)


def test_calibration_of_equal_confidences_at_every_bound():
    """Each bound belongs to the bin below it, also where k / 15 is rounded; NaN is refused."""
    bounds = [k / 15 for k in range(16)]
    sure = np.repeat(bounds, 1_000)
    right = np.tile(np.arange(1_000) < 700, 16)
    found = metrics.calibration(sure, right)
    assert found.counts.tolist() == [2_000] + [1_000] * 14
    exact = sum(1_000 * abs(Fraction(7, 10) - Fraction(k, 15)) for k in range(2, 16))
    exact += abs(1_400 - Fraction(1_000, 15))
    assert found.error == pytest.approx(float(exact / 16_000), rel=1e-12)
    for wrong in (math.nan, math.nextafter(1, 2), -5e-324):
        with pytest.raises(ValueError, match="confidence must be from 0 to 1"):
            metrics.calibration([0.5, wrong], [0, 1])
    assert metrics.calibration([5e-324, math.nextafter(1, 0)], [0, 1]).counts[[0, -1]].tolist() == [1, 1]


@pytest.mark.parametrize("power", [-300, -150, 0, 150, 300])
def test_equal_and_opposite_features_of_any_size(power):
    """Similarities beyond float64 become its largest number; others are those of exact arithmetic."""
    size, largest = 10.0**power, np.finfo(float).max
    with localcontext(prec=60):
        exact = Decimal(size)
        same = metrics.similarities([size, size, 0], [size, size, 0])
        other = metrics.similarities([size, 0, 0], [0, size, 0])
        assert same[0] == pytest.approx(min(float(2 * exact * exact), largest), rel=1e-12, abs=5e-324)
        assert same[1] == pytest.approx(float((2 * exact * exact).sqrt()), rel=1e-12)
        assert same[6] == pytest.approx(1, rel=1e-12)
        assert same[[4, 5, 7, 8, 9]].tolist() == [0] * 5
        assert same[11] == pytest.approx(min(float(1 / (2 * exact)), largest), rel=1e-12)
        assert other[8] == pytest.approx(min(float((2 * exact * exact).sqrt()), largest), rel=1e-12)
        assert other[[0, 1, 2, 3, 6, 11]].tolist() == [0] * 6


@pytest.mark.parametrize("frames", [3_000, pytest.param(3_000_000, marks=pytest.mark.long)])
def test_a_mean_over_many_frames(frames):
    t = np.arange(frames)
    a, b = (Events(t, x, 0 * t, 0 * t, (5, 1)) for x in (0 * t, 1 + t % 3))
    found = metrics.chamfer(a, b, fps=1e6)
    assert found.used == frames - 1
    # one event in each frame but the first, which has two
    assert found.frames[1:].tolist() == [1 + n % 3 for n in range(2, frames)]
    assert found.value == pytest.approx(math.fsum(found.frames) / found.used, rel=1e-12)


@pytest.mark.parametrize("count", [MANY + 1, pytest.param(10_000_001, marks=pytest.mark.long)])
def test_accuracy_of_many_samples_is_exact(count):
    scores, targets = torch.zeros(count, 2), torch.zeros(count, dtype=torch.int64)
    targets[-1] = 1
    assert share_right(scores, targets) == (count - 1) / count
    predicted = np.zeros(count, int)
    assert metrics.confusion_matrix(predicted, targets, 2).tolist() == [[count - 1, 0], [1, 0]]
    assert metrics.class_accuracies(predicted[:-1], targets[:-1], 1).tolist() == [1.0]
    found = metrics.calibration(np.full(count, 0.1), targets == 0)
    exact = Fraction(count - 1, count) - Fraction(0.1)
    assert abs(Fraction(found.error) - exact) < Fraction(1, 10**9)


def test_costs_beyond_the_limit_are_only_beyond_it():
    where = np.array([5]), np.array([5]), np.array([1])
    for limit in (0, 24, 25, 26):
        cost = nearest_spikes(*where, np.array([8]), np.array([9]), np.array([1]), (20, 20), 1.0, limit)[0]
        assert cost == 25 if limit >= 25 else cost > limit
