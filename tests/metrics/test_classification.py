"""Numbers of a classifier against loops that say the same in the plainest way."""

from itertools import combinations
from math import exp

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from nvsdata import metrics
from nvsdata.metrics.classification import _orders

CLASSES = 4
PAIRS = st.lists(st.tuples(st.integers(-1, CLASSES - 1), st.integers(0, CLASSES - 1)), max_size=40)
SCORES = hnp.arrays(np.float64, st.tuples(st.integers(1, 5), st.just(3)), elements=st.floats(-20, 20))


@given(PAIRS)
def test_confusion_counts_every_pair_once(pairs):
    predicted, targets = [p for p, _ in pairs], [t for _, t in pairs]
    slow = np.zeros((CLASSES, CLASSES), int)
    for named, wanted in pairs:
        if named >= 0:
            slow[wanted, named] += 1
    assert np.array_equal(metrics.confusion_matrix(predicted, targets, CLASSES), slow)


@given(PAIRS)
def test_class_accuracy_is_the_share_of_a_class_that_is_right(pairs):
    found = metrics.class_accuracies([p for p, _ in pairs], [t for _, t in pairs], CLASSES)
    for number in range(CLASSES):
        answers = [named == number for named, wanted in pairs if wanted == number]
        slow = sum(answers) / len(answers) if answers else np.nan
        assert found[number] == pytest.approx(slow, nan_ok=True)


def slow_calibration(confidence, right, bins):
    rows, error = [], 0.0
    for number in range(bins):
        low, high = number / bins, (number + 1) / bins
        inside = [
            (c, r) for c, r in zip(confidence, right, strict=True) if low < c <= high or (number == 0 and c == 0.0)
        ]
        mean = [float(np.mean(column)) for column in zip(*inside, strict=True)] or [np.nan, np.nan]
        rows.append((len(inside), *mean))
        if inside:
            error += len(inside) / len(confidence) * abs(mean[1] - mean[0])
    return rows, error


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans()), min_size=1, max_size=40), st.integers(1, 20))
def test_calibration_error_is_its_definition(pairs, bins):
    confidence, right = [c for c, _ in pairs], [r for _, r in pairs]
    found = metrics.calibration(confidence, right, bins)
    rows, error = slow_calibration(confidence, right, bins)
    assert found.error == pytest.approx(error, abs=1e-12)
    assert np.allclose(np.stack(found[:3], 1), rows, equal_nan=True)


def test_calibration_of_a_bound_belongs_to_the_bin_below():
    found = metrics.calibration([0.0, 0.5, 0.50001, 1.0], [0, 1, 1, 1], bins=2)
    assert found.counts.tolist() == [2, 2]


@given(SCORES)
def test_verdicts_are_the_highest_softmax(scores):
    named, confidence = metrics.predictions(scores)
    for row, best, sure in zip(scores, named, confidence, strict=True):
        shares = [exp(v) / sum(exp(w) for w in row) for v in row]
        assert sure == pytest.approx(max(shares))
        assert shares[best] == pytest.approx(max(shares))


def test_nan_names_no_class():
    named, confidence = metrics.predictions([[0.0, np.nan], [np.inf, 0.0], [2.0, 0.0]])
    assert named.tolist() == [-1, -1, 0]
    assert confidence[:2].tolist() == [0, 0]
    assert metrics.accuracy_by_votes(np.full((1, 2, 3, 2), np.nan), [0, 1, 0]) == [metrics.accuracy([0, 0, 0])] * 2


def share_of_subset(voters, targets, windows):
    return np.mean([(round_[list(windows)].sum(0).argmax(-1) == targets).mean() for round_ in voters])


@given(st.integers(1, 2), st.integers(1, 7), st.integers(1, 12), st.integers(0, 1000))
def test_votes_are_a_mean_over_subsets(rounds, windows, count, seed):
    rng = np.random.default_rng(seed)
    # whole numbers add up alike in any order
    voters = rng.integers(-9, 0, (rounds, windows, count, 3)).astype(float)
    targets = rng.integers(0, 3, count)
    found = [of_size.value for of_size in metrics.accuracy_by_votes(voters, targets)]
    for k in range(1, windows + 1):
        every = [share_of_subset(voters, targets, subset) for subset in combinations(range(windows), k)]
        if windows <= 3 or k in (1, windows):
            assert found[k - 1] == pytest.approx(np.mean(every))
        assert min(every) - 1e-9 <= found[k - 1] <= max(every) + 1e-9


@pytest.mark.parametrize("windows", [1, 3, 7, 10, 19, 20, 21])
def test_each_window_comes_first_as_often_in_at_least_20_orders(windows):
    orders = _orders(windows)
    assert 20 <= len(orders) < 20 + windows
    assert all(sorted(order.tolist()) == list(range(windows)) for order in orders)
    for place in range(windows):
        assert set(np.bincount([order[place] for order in orders], minlength=windows)) == {len(orders) // windows}
    assert np.array_equal(orders, _orders(windows))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: metrics.confusion_matrix([0, 1], [0], 2), "must be .N., not"),
        (lambda: metrics.confusion_matrix([[0]], [[0]], 2), r"must be .N., not \(1, 1\) and \(1, 1\)"),
        (lambda: metrics.confusion_matrix([-2], [0], 2), "predicted must be from -1 to 1, not -2 to -2"),
        (lambda: metrics.class_accuracies([0, 1], [1, 2], 2), "targets must be from 0 to 1, not 1 to 2"),
        (lambda: metrics.confusion_matrix([2], [0], 2), "predicted must be from -1 to 1, not 2 to 2"),
        (lambda: metrics.class_accuracies([0], [-1], 2), "targets must be from 0 to 1, not -1 to -1"),
        (lambda: metrics.calibration([], []), "N > 0"),
        (lambda: metrics.calibration([0.5], [1, 0]), r"not \(1,\) and \(2,\)"),
        (lambda: metrics.calibration([[0.5]], [[1]]), r"not \(1, 1\) and \(1, 1\)"),
        (lambda: metrics.calibration([-0.5, 0.5], [1, 0]), "from 0 to 1, not -0.5 to 0.5"),
        (lambda: metrics.calibration([0.5, 1.5], [1, 0]), "from 0 to 1, not 0.5 to 1.5"),
        (lambda: metrics.calibration([np.nan], [1]), "from 0 to 1, not nan"),
        (lambda: metrics.calibration([0.5], [1], bins=0), "at least 1, not 0"),
        (lambda: metrics.accuracy_by_votes(np.zeros((1, 2, 3)), [0, 0, 0]), "voters must be"),
        (lambda: metrics.accuracy_by_votes(np.zeros((1, 2, 3, 2)), [0, 0]), "voters must be"),
        *(
            (lambda shape=shape: metrics.accuracy_by_votes(np.zeros(shape), np.zeros(shape[2])), "voters must be")
            for shape in ((0, 2, 3, 2), (1, 0, 3, 2), (1, 2, 0, 2), (1, 2, 3, 0))
        ),
    ],
)
def test_what_makes_no_sense_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
