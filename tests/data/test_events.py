import itertools
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events, FormatError


def make(t, **options):
    n = len(t)
    return Events(np.array(t, np.int64), np.arange(n), np.arange(n), np.zeros(n, int), **options)


def test_unsorted_times_are_sorted_and_ties_keep_their_order():
    ev = make([5, 3, 5, 1])
    assert ev.t.tolist() == [1, 3, 5, 5]
    assert ev.x.tolist() == [3, 1, 0, 2]


def test_columns_have_the_promised_types():
    ev = make([1, 2])
    assert (ev.t.dtype, ev.x.dtype, ev.y.dtype, ev.p.dtype) == (np.int64, np.int16, np.int16, np.uint8)
    assert ev.sensor_size == (2, 2)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (([1], [1, 2], [1], [1]), "equally long"),
        (([1.5], [1], [1], [1]), "integers"),
        (([1], [1.5], [1], [1]), "integers"),
        (([1], [-1], [1], [1]), "x must lie"),
        (([1], [1], [40_000], [1]), "y must lie"),
        (([1], [1], [1], [2]), "polarity"),
        (([1], [1], [1], [-1]), "polarity"),
        (([[1]], [[1]], [[1]], [[1]]), "one-dimensional"),
        (([1, 2], [3, 4], [100_000, 200_000], [0, 1]), r"y .* not 100000 to 200000; the order is Events\(t, x, y, p\)"),
        (([2**62], [1], [1], [1]), "times must lie"),
        (([-(2**62)], [1], [1], [1]), "times must lie"),
        ((np.array([2**63], np.uint64), [1], [1], [1]), "times must lie"),
    ],
)
def test_bad_columns_are_refused(columns, message):
    with pytest.raises(ValueError, match=message):
        Events(*(np.array(c) for c in columns))


def test_coordinates_outside_the_sensor_are_refused():
    with pytest.raises(ValueError, match=r"4x4 pixels, outside the sensor of 3x4$"):
        make([1, 2, 3, 40], sensor_size=(3, 4))
    with pytest.raises(ValueError, match=r"outside the sensor of 34x34; the order is Events\(t, x, y, p\)"):
        Events([1, 2], [3, 4], [1_000, 2_000], [0, 1], (34, 34))
    with pytest.raises(ValueError, match="events reach 8x3 pixels, outside the sensor of 5x4"):
        Events([0], [7], [2], [1], (5, 4))


@given(events(), st.integers(-100, 50_000), st.integers(0, 50_000))
def test_window_holds_what_its_definition_says(ev, start, length):
    inside = (ev.t >= start) & (ev.t < start + length)
    assert ev.window(start, start + length) == ev[inside]


@given(events(), st.lists(st.integers(-10, 400_000), max_size=6))
def test_any_split_joins_back(ev, cuts):
    edges = [None, *sorted(cuts), None]
    parts = [ev.window(a, b) for a, b in itertools.pairwise(edges)]
    assert np.concatenate([part.t for part in parts]).tolist() == ev.t.tolist()
    assert np.concatenate([part.x for part in parts]).tolist() == ev.x.tolist()


def test_a_window_that_ends_before_it_begins_is_refused():
    with pytest.raises(ValueError, match="ends before"):
        make([1, 2]).window(5, 4)


@given(events())
def test_structured_arrays_go_round(ev):
    assert Events.from_structured(ev.to_structured(), ev.sensor_size) == ev


def test_a_structured_array_without_time_is_refused():
    with pytest.raises(ValueError, match="lacks the fields"):
        Events.from_structured(np.zeros(3, [("x", int), ("y", int), ("p", int)]))


def test_tensors_share_memory():
    ev = make([1, 2, 3])
    tensors = ev.torch()
    assert tensors["t"].tolist() == [1, 2, 3]
    assert tensors["t"].data_ptr() == ev.t.ctypes.data


def test_masks_and_indices_stay_sorted():
    ev = make([1, 2, 3, 4])
    assert ev[np.array([3, 0])].t.tolist() == [1, 4]
    assert ev[1].t.tolist() == [2]
    assert ev[-1].t.tolist() == [4]


def test_empty_events_work():
    ev = Events.empty((34, 34))
    assert len(ev) == 0
    assert ev.duration == 0
    assert ev.window(0, 10) == ev
    assert len(ev.to_structured()) == 0


def test_format_errors_survive_pickling():
    error = pickle.loads(pickle.dumps(FormatError("a.bin", "truncated", offset=7)))
    assert (error.path, error.offset, error.reason) == ("a.bin", 7, "truncated")
    assert "a.bin: byte 7: truncated" in str(error)


def test_importing_the_package_imports_no_torch():
    import subprocess
    import sys

    code = "import sys, nvsdata; nvsdata.read; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_every_public_name_can_be_had():
    import nvsdata

    for name in nvsdata.__all__:
        assert getattr(nvsdata, name) is not None
    with pytest.raises(AttributeError, match="nonsense"):
        _ = nvsdata.nonsense


def test_events_can_be_gone_through_and_end():
    ev = make([1, 2, 3])
    assert [one.t.tolist() for one in ev] == [[1], [2], [3]]
    assert [len(one) for one in list(ev)] == [1, 1, 1]
    assert ev[-1].t.tolist() == [3]
    assert ev[np.int64(1)].t.tolist() == [2]
    for beyond in (3, -4):
        with pytest.raises(IndexError):
            ev[beyond]
    assert list(Events.empty((3, 3))) == []


@given(events(), st.integers(-300, 50_000), st.integers(1, 50_000))
def test_a_window_lasts_no_longer_than_what_it_is_cut_from(ev, start, length):
    last = int(ev.t.max(initial=0))
    known = Events(*ev.columns, ev.sensor_size, start=-200, end=last + 5)
    cut = known.window(start, start + length)
    begin = max(start, -200)
    assert (cut.start, cut.end) == (begin, max(begin, min(start + length - 1, last + 5)))
    assert (known.window().start, known.window().end) == (-200, last + 5)
    # nothing is said of the end of what says nothing itself
    cut = ev.window(start, start + length)
    assert cut.end == (cut.t[-1] if len(cut) else start)


@pytest.mark.parametrize(
    "bounds", [{"start": 6}, {"end": 8}, {"start": -(2**62)}, {"end": 2**62}, {"start": 3, "end": 2}]
)
def test_a_time_that_does_not_hold_the_events_is_refused(bounds):
    with pytest.raises(ValueError, match=r"events|lie between"):
        make([5, 9], **bounds)


def test_wrong_polarities_are_told_but_not_all_of_them():
    with pytest.raises(ValueError, match=r"polarity must be 0 \(OFF\) or 1 \(ON\), not \[2, 3, 4, 5\]$"):
        Events(range(6), [0] * 6, [0] * 6, [2, 7, 3, 4, 5, 6])
