import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsdata import Events
from nvsdata.data.events import Columns, sort_by_time
from nvsdata.kernels.decode.order import is_sorted, late, moved, stable_order


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


@given(
    t=st.lists(st.integers(-30, 30), min_size=40, max_size=300),
    strays=st.lists(st.tuples(st.integers(0, 299), st.integers(-60, 60)), max_size=8),
    late_by=st.integers(0, 2**61),
)
def test_a_few_late_events_are_put_where_they_belong(t, strays, late_by):
    t = np.sort(np.array(t, np.int64)) + late_by
    for place, shift in strays:
        t[place % t.size] += shift
    number = np.arange(t.size)
    columns = Columns(t, number.astype(np.int16), (number % 7).astype(np.int16), (number % 2).astype(np.uint8))
    found = sort_by_time(columns)
    order = np.argsort(t, kind="stable")
    for column, expected in zip(found, columns.take(order), strict=True):
        assert column.dtype == expected.dtype
        assert np.array_equal(column, expected)
    # late is what comes after a later one
    wanted = [i for i in range(t.size) if i and t[i] < t[:i].max()]
    assert late(t, t.size).tolist() == wanted
    for most in (0, 2):
        found = late(t, most)
        assert found.tolist() == wanted if len(wanted) <= most else found is None


@pytest.mark.parametrize("beyond", [0, 1])
def test_moved_times_end_at_the_end_even_where_float64_has_no_odd_numbers(beyond):
    end = 2**53 + 3
    assert moved(np.array([beyond]), np.ones(1, np.float32), end + 1.0, 0, end + beyond).tolist() == [end + beyond]
