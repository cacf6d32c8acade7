import math
import sys
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsdata.metrics import area_under_roc, roc, similarities


def slow(a, b):
    """Table 5.4, a number at a time."""

    def ratio(x, y):
        return x / y if y > 0 else 0.0

    def log(x):
        return math.log(max(x, 1e-10))

    pairs = list(zip(a, b, strict=True))
    dot = sum(x * y for x, y in pairs)
    return [
        dot,
        math.sqrt(dot),
        math.sqrt(sum(math.sqrt(x) * math.sqrt(y) for x, y in pairs)),
        math.sqrt(sum(ratio(x * y, x + y) for x, y in pairs)),
        sum(abs(x - y) for x, y in pairs),
        math.sqrt(sum(ratio((x - y) ** 2, x + y) for x, y in pairs)),
        ratio(dot, math.sqrt(sum(x * x for x in a)) * math.sqrt(sum(y * y for y in b))),
        math.sqrt(sum((math.sqrt(x) - math.sqrt(y)) ** 2 for x, y in pairs)),
        math.sqrt(sum((x - y) ** 2 for x, y in pairs)),
        sum(x * (log(x) - log(y)) + y * (log(y) - log(x)) for x, y in pairs) / 2,
        sum(ratio(math.sqrt(max(x, y)), math.sqrt(x + y)) for x, y in pairs),
        ratio(sum(min(x, y) for x, y in pairs), sum(a) * sum(b)),
    ]


features = st.lists(st.floats(0, 10).map(lambda v: v if v > 1e-6 else 0.0), min_size=1, max_size=12)


@given(features, st.randoms(use_true_random=False))
def test_they_are_those_of_the_table(a, random):
    b = random.sample(a, len(a))
    assert np.allclose(similarities(a, b), slow(a, b), rtol=1e-9, atol=1e-9)


def exact(a, b):
    """Table 5.4 with 60 digits and any exponent, cut to what float64 holds."""
    zero, floor = Decimal(0), Decimal.from_float(1e-10)
    with localcontext(prec=60):
        pairs = [(Decimal(x), Decimal(y)) for x, y in zip(a, b, strict=True)]
        dot = sum(x * y for x, y in pairs)
        both = [(x, y) for x, y in pairs if x + y]
        of_a, of_b = (sum(column) for column in zip(*pairs, strict=True))
        length = sum(x * x for x, _ in pairs).sqrt() * sum(y * y for _, y in pairs).sqrt()
        found = [
            dot,
            dot.sqrt(),
            sum((x * y).sqrt() for x, y in pairs).sqrt(),
            sum((x * y / (x + y) for x, y in both), zero).sqrt(),
            sum(abs(x - y) for x, y in pairs),
            sum(((x - y) ** 2 / (x + y) for x, y in both), zero).sqrt(),
            dot / length if length else zero,
            sum((x.sqrt() - y.sqrt()) ** 2 for x, y in pairs).sqrt(),
            sum((x - y) ** 2 for x, y in pairs).sqrt(),
            sum((x - y) * (max(x, floor).ln() - max(y, floor).ln()) for x, y in pairs) / 2,
            sum(((max(x, y) / (x + y)).sqrt() for x, y in both), zero),
            sum(min(x, y) for x, y in pairs) / (of_a * of_b) if of_a * of_b else zero,
        ]
        return [float(min(value, Decimal(sys.float_info.max))) for value in found]


# as many of each size, some equal and some next to each other
sizes = st.builds(lambda part, power: part * 10.0**power, st.floats(1, 9.99), st.integers(-300, 299))
wide = st.one_of(st.just(0.0), sizes, st.sampled_from((1e-300, 1e300, 1.0, math.nextafter(1, 2), 1e-10)))


@given(st.lists(st.tuples(wide, wide), min_size=1, max_size=6))
def test_they_are_right_whatever_the_size_of_features(pairs):
    a, b = zip(*pairs, strict=True)
    with np.errstate(all="raise", under="ignore"):
        found = similarities(a, b)
    # below 1e-300 float64 has fewer digits
    np.testing.assert_allclose(found, exact(a, b), rtol=1e-12, atol=1e-300)


@given(st.lists(st.tuples(*[st.floats(0, allow_infinity=False)] * 2), min_size=1, max_size=6))
def test_they_are_finite_for_all_finite_features(pairs):
    assert np.isfinite(similarities(*zip(*pairs, strict=True))).all()


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ([], []),
        ([0, 0, 0], [0, 0, 0]),
        ([0, 0, 0], [0.2, 0.3, 0.5]),
        ([0.2, 0.3, 0.5], [0.2, 0.3, 0.5]),
        ([1, 0, 0], [0, 1, 0]),
        ([1, 0, 0], [1, 0, 0]),
        ([1e-300, 1], [1, 1e-300]),
    ],
)
def test_they_are_finite_for_awkward_features(a, b):
    assert np.isfinite(similarities(a, b)).all()
    assert np.allclose(similarities(a, b), similarities(b, a))


def test_equal_features_are_not_apart():
    apart = similarities([0.6, 0.8, 0.0], [0.6, 0.8, 0.0])[[4, 5, 7, 8, 9]]
    assert np.allclose(apart, 0)
    assert similarities([0.6, 0.8], [0.6, 0.8])[6] == pytest.approx(1)


def test_many_pairs_at_once():
    a, b = np.random.default_rng(0).random((2, 7, 5))
    assert np.allclose(similarities(a, b), [slow(x.tolist(), y.tolist()) for x, y in zip(a, b, strict=True)])


@pytest.mark.parametrize(("a", "b"), [([-1.0], [1.0]), ([np.nan], [1.0]), ([1.0, 2.0], [1.0]), (1.0, 1.0)])
def test_bad_features_are_refused(a, b):
    with pytest.raises(ValueError, match=r"must (be|contain)"):
        similarities(a, b)


@pytest.mark.parametrize(
    ("scores", "same", "why"),
    [
        ([1.0, np.nan, 2.0], [1, 0, 1], "1 of 3 scores are NaN"),
        ([1.0, 2.0], [1, 0, 1], "one shape"),
        ([[1.0, 2.0]], [[1, 0]], "one shape"),
        ([1.0, 2.0], [1, 2], "only 1 and 0"),
        ([1.0, 2.0], [1, np.nan], "only 1 and 0"),
    ],
)
def test_an_area_of_nonsense_is_refused(scores, same, why):
    with pytest.raises(ValueError, match=why):
        area_under_roc(scores, same)


@given(
    st.lists(st.tuples(st.sampled_from((-math.inf, -2, -1, 0, 1, math.inf)), st.booleans()), min_size=2, max_size=30)
)
def test_the_area_is_the_probability_of_the_right_order(pairs):
    scores, same = (list(column) for column in zip(*pairs, strict=True))
    if len(set(same)) < 2:
        with pytest.raises(ValueError, match="both needed"):
            roc(scores, same)
        return
    wins = [
        (a > b) + (a == b) / 2
        for a, of_a in zip(scores, same, strict=True)
        for b, of_b in zip(scores, same, strict=True)
        if of_a and not of_b
    ]
    assert area_under_roc(scores, same) == pytest.approx(sum(wins) / len(wins))
    false, true = roc(scores, same)
    assert (false[0], true[0], false[-1], true[-1]) == (0, 0, 1, 1)


def test_a_curve_has_a_point_for_each_score_from_the_highest_down():
    false, true = roc([2, 3, 1, 2, 2, 0], [0, 1, 0, 1, 1, 1])
    assert false.tolist() == [0, 0, 0.5, 1, 1]
    assert true.tolist() == [0, 0.25, 0.75, 0.75, 1]
    assert [rates.tolist() for rates in roc([5, 5], [1, 0])] == [[0, 1], [0, 1]]


@pytest.mark.parametrize("same", [[1, 1], [0, 0]])
def test_a_curve_needs_both_kinds(same):
    with pytest.raises(ValueError, match="both needed"):
        roc([1.0, 2.0], same)
