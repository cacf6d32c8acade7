import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsdata import Events
from nvsdata.kernels.order import is_sorted, stable_order


@pytest.mark.parametrize("n", [0, 1, 2, 4_095, 4_096, 4_097, 9_000])
def test_rising_and_level_values_never_fall(n):
    assert is_sorted(np.arange(n) // 3)


@pytest.mark.parametrize("at", [1, 2, 4_095, 4_096, 4_097, 8_192, 8_999])
def test_one_fall_is_found_wherever_it_is(at):
    t = np.arange(9_000)
    t[at] = t[at - 1] - 1
    assert not is_sorted(t)


@given(st.lists(st.integers(-(2**62) + 1, 2**62 - 1) | st.integers(0, 9) | st.integers(10**15, 10**15 + 5_000)))
def test_digits_sort_as_comparisons_do(values):
    t = np.array(values, np.int64)
    assert stable_order(t).tolist() == np.argsort(t, kind="stable").tolist()


@pytest.mark.parametrize("n", [1_024, 1_025, 5_000])
@pytest.mark.parametrize("span", [1, 50, 10**7, 2**44 - 1, 2**44, 2**61])
def test_events_are_sorted_whatever_their_span(n, span):
    random = np.random.default_rng(n)
    t = random.integers(0, span, n)
    t[:2] = span, 0
    ev = Events(t, np.arange(n) % 30_000, np.zeros(n, int), np.zeros(n, int))
    order = np.argsort(t, kind="stable")
    assert ev.t.tolist() == t[order].tolist()
    assert ev.x.tolist() == order.tolist()
