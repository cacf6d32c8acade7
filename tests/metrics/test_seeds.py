"""Figures of runs that differ in their seed."""

import pytest
from scipy import stats

from nvsdata.metrics.seeds import by_settings, points_apart, spread


def test_spread_is_mean_and_standard_deviation():
    assert spread([0.9, 0.91, 0.92]) == "0.910 ± 0.010"
    assert (spread({0: 0.9}.values()), spread([])) == ("0.900", "")


@pytest.mark.parametrize(("changes", "marked"), [((1.0, 1.1, 1.2), True), ((-1.0, 1.0, 1.2), False)])
def test_differences_are_those_of_a_paired_t_test(changes, marked):
    others = {seed: 0.5 + seed / 10 for seed in range(3)}
    changed = {seed: others[seed] + change / 100 for seed, change in enumerate(changes)}
    found = stats.ttest_rel([*changed.values()], [*others.values()])
    low, high = found.confidence_interval()
    text = f"{sum(changes) / 3:+.1f} ({100 * low:+.1f} to {100 * high:+.1f})"
    # seeds that the others don't have say nothing, and the order doesn't matter
    assert points_apart({7: 0.1} | changed, dict(reversed(others.items()))) == text + " *" * marked
    assert (found.pvalue < 0.05) == marked


def test_one_common_seed_has_no_interval():
    assert points_apart({0: 0.51, 1: 0.9}, {0: 0.5}) == "+1.0"
    assert points_apart({1: 0.9}, {0: 0.5}) == ""


def test_equal_differences_have_an_interval_of_no_width():
    assert points_apart({0: 0.5, 1: 0.75}, {0: 0.25, 1: 0.5}) == "+25.0 (+25.0 to +25.0) *"
    assert points_apart({0: 0.5, 1: 0.75}, {0: 0.5, 1: 0.75}) == "+0.0 (+0.0 to +0.0)"


def test_results_are_by_settings_name_and_seed():
    lines = [{"settings": "k 2", "seed": seed, "one": seed / 10, "loss": 1} for seed in (1, 0)]
    assert by_settings([*lines, lines[0] | {"settings": "default"}], ["one"]) == {
        "k 2": {"one": {1: 0.1, 0: 0.0}},
        "default": {"one": {1: 0.1}},
    }
