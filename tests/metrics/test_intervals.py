"""Intervals and paired tests against SciPy's, against all exchanges, and against samples whose truth is known."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import stats

from nvsdata.metrics import accuracy, paired_test


@given(st.lists(st.booleans(), min_size=1, max_size=60), st.sampled_from((0.5, 0.9, 0.95, 0.999)))
def test_the_interval_of_one_prediction_per_recording_is_wilsons(right, level):
    low, high = stats.binomtest(sum(right), len(right)).proportion_ci(level, method="wilson")
    assert accuracy(right, level) == pytest.approx((np.mean(right), low, high), abs=1e-12)


def test_equal_predictions_of_a_recording_count_once_and_independent_ones_each():
    rng = np.random.default_rng(0)
    one = rng.random(20_000) < 0.8
    assert accuracy(np.stack([one] * 5)) == pytest.approx(accuracy(one), abs=1e-9)
    five = rng.random((5, 20_000)) < 0.8
    assert accuracy(five) == pytest.approx(accuracy(five.ravel()), abs=2e-4)


def covered(trials, of):
    return sum(low <= truth <= high for (low, high), truth in (of(n) for n in range(trials))) / trials


def test_intervals_contain_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(1)

    def draws(a, b):
        # recordings differ in difficulty: windows of one are correlated
        return rng.random((5, 200)) < rng.beta(a, b, 200)

    assert covered(1000, lambda n: (accuracy(draws(9, 1))[1:], 0.9)) == pytest.approx(0.95, abs=0.025)
    shown = covered(1000, lambda n: (paired_test(draws(9, 1), draws(4, 1)).interval, 0.1))
    assert shown == pytest.approx(0.95, abs=0.025)

    # few recordings have windows on which the classifiers differ, and each of them differs on few
    def of_two(n):
        easy = rng.beta(0.97, 0.03, 200)
        first, second = (rng.random((25, 200)) < chance for chance in (easy, np.clip(easy - 0.01, 0, 1)))
        return paired_test(first, second).interval, truth

    many = rng.beta(0.97, 0.03, 1_000_000)
    truth = (many - np.clip(many - 0.01, 0, 1)).mean()
    assert covered(1000, of_two) == pytest.approx(0.95, abs=0.025)


@given(hnp.arrays(bool, (2, 12)))
def test_with_one_prediction_per_recording_the_test_is_mcnemars(pair):
    better, worse = (pair[0] & ~pair[1]).sum(), (pair[1] & ~pair[0]).sum()
    wanted = stats.binomtest(int(better), int(better + worse)).pvalue if better + worse else 1.0
    found = paired_test(*pair)
    assert found.p == pytest.approx(wanted, rel=1e-9)
    assert found.difference == pytest.approx(pair[0].mean() - pair[1].mean())
    assert -1 <= found.interval[0] <= found.difference <= found.interval[1] <= 1


@given(hnp.arrays(bool, (2, 3, 7)))
def test_with_several_predictions_the_test_counts_exchanges(pair):
    gains = pair[0].sum(0).astype(int) - pair[1].sum(0)
    sums = [abs(np.dot(gains, signs)) for signs in product((1, -1), repeat=7)]
    assert paired_test(*pair).p == pytest.approx(np.mean([total >= abs(gains.sum()) for total in sums]))


def test_the_paired_interval_is_bonett_and_prices():
    first, second = np.repeat([[1, 1, 0, 0], [1, 0, 1, 0]], [70, 14, 5, 11], axis=1)
    of, (b, c) = 102, (15 / 102, 6 / 102)
    half = stats.norm.ppf(0.975) * math.sqrt((b + c - (b - c) ** 2) / of)
    assert paired_test(first, second).interval == pytest.approx((b - c - half, b - c + half))


@pytest.mark.parametrize("right", [[], [[]], 1, [0, 2], [0.5]])
def test_what_are_no_predictions_is_refused(right):
    with pytest.raises(ValueError, match=r"there must be predictions|predictions must be 0 or 1"):
        accuracy(right)


def test_predictions_of_other_recordings_and_levels_out_of_range_are_refused():
    with pytest.raises(ValueError, match=r"must have one shape, not \(3,\) and \(2,\)"):
        paired_test([1, 0, 1], [1, 0])
    for level in (0, 1, 95, math.nan):
        with pytest.raises(ValueError, match="level must be between 0 and 1"):
            accuracy([1, 0], level)
