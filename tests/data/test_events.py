import itertools
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events, FormatError
from nvsdata.data import events as module
from nvsdata.data.events import bounds_of, concatenate, concatenate_events, sort_by_time


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
        (([1], [-1], [1], [1]), "x must be between"),
        (([1], [1], [40_000], [1]), "y must be between"),
        (([1], [1], [1], [2]), "polarity"),
        (([1], [1], [1], [-1]), "polarity"),
        (([[1]], [[1]], [[1]], [[1]]), "one-dimensional"),
        (([1, 2], [3, 4], [100_000, 200_000], [0, 1]), r"y .* not 100000 to 200000; the order is Events\(t, x, y, p\)"),
        (([2**62], [1], [1], [1]), "times must be between"),
        (([-(2**62)], [1], [1], [1]), "times must be between"),
        ((np.array([2**63], np.uint64), [1], [1], [1]), "times must be between"),
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
    with pytest.raises(ValueError, match="has no fields"):
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
    with pytest.raises(ValueError, match=r"events|be between"):
        make([5, 9], **bounds)


def test_wrong_polarities_are_told_but_not_all_of_them():
    with pytest.raises(ValueError, match=r"polarity must be 0 \(OFF\) or 1 \(ON\), not \[2, 3, 4, 5\]$"):
        Events(range(6), [0] * 6, [0] * 6, [2, 7, 3, 4, 5, 6])


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (([0], [32_767], [0], [0]), r"x must be between 0 and 32766, not 32767 to 32767; the order is Events\(t, x"),
        (([0], [0], [32_767], [0]), r"y must be between 0 and 32766, not 32767 to 32767; the order is Events\(t, x"),
        (([0], [0], [-1], [0]), r"y must be between 0 and 32766, not -1 to -1$"),
        (([0, 9], [-3, 5], [0, 0], [0, 0]), r"x must be between 0 and 32766, not -3 to 5$"),
        (([0], [0.5], [0], [0]), r"x must be integers \(whole µs and pixels\), not float64$"),
        (([0], [True], [0], [0]), r"x must be integers \(whole µs and pixels\), not bool$"),
        (([2**62, 5], [0, 0], [0, 0], [0, 0]), f"between -2\\^62 and 2\\^62 µs, not 5 to {2**62}$"),
        (([-(2**62), 5], [0, 0], [0, 0], [0, 0]), f"between -2\\^62 and 2\\^62 µs, not -{2**62} to 5$"),
        (([0], [0], [0], [0.5]), r"polarity must be 0 \(OFF\) or 1 \(ON\), not \[0\.5\]$"),
    ],
)
def test_the_last_values_that_are_refused(columns, message):
    with pytest.raises(ValueError, match=message):
        Events(*columns)


def test_the_last_values_that_are_taken():
    ends = [-(2**62) + 1, 2**62 - 1]
    ev = Events(ends, [0, 32_766], [32_766, 0], [1.0, 0.0], (32_767, 32_767), start=ends[0], end=ends[1])
    assert (ev.t.tolist(), ev.x.tolist(), ev.y.tolist(), ev.p.tolist()) == (ends, [0, 32_766], [32_766, 0], [1, 0])
    assert (ev.start, ev.end, ev.sensor_size) == (*ends, (32_767, 32_767))
    assert Events(ends, [0, 32_766], [32_766, 0], [1, 0]).sensor_size == (32_767, 32_767)
    assert make([5, 9], start=5, end=9).end == 9
    assert make([5], start=5, end=5).duration == 0
    for size, place in (((5, 9), (4, 8)), ((9, 5), (8, 4))):
        assert Events([0], *([c] for c in place), [0], size).sensor_size == size
    # numpy makes float64 of an empty list
    none = Events([], [], [], [])
    assert (none.start, none.end, none.duration, none.sensor_size, none.t.dtype) == (0, 0, 0, (1, 1), np.int64)


@pytest.mark.parametrize("size", [(0, 5), (5, 0), (32_768, 5), (5, 32_768), (-1, 5)])
def test_sensors_of_no_size_are_refused(size):
    with pytest.raises(ValueError, match=rf"between 1 and 32767, not \({size[0]}, {size[1]}\)$"):
        Events([], [], [], [], size)
    for longest in ((1, 32_767), (32_767.0, 1.0)):
        assert Events([], [], [], [], longest).sensor_size == longest


def test_times_as_small_as_coordinates_are_told_apart():
    with pytest.raises(ValueError, match=r"sensor of 30x34; the order is Events\(t, x, y, p\)$"):
        Events([33], [30], [0], [0], (30, 34))
    with pytest.raises(ValueError, match=r"events reach 31x1 pixels, outside the sensor of 30x34$"):
        Events([34], [30], [0], [0], (30, 34))


@pytest.mark.parametrize("place", [(5, 0), (0, 9), (0, 5)])
def test_a_place_beyond_either_side_is_refused(place):
    size = (5, 9) if place != (0, 5) else (9, 5)
    with pytest.raises(ValueError, match=f"events reach {place[0] + 1}x{place[1] + 1} pixels, outside the sensor of"):
        Events([10], *([c] for c in place), [0], size)


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ({"start": 3, "end": 2}, "events end at 2 µs, before they start at 3 µs"),
        ({"start": 6}, "events at 5 to 9 µs aren't within start=6 and end=None"),
        ({"end": 8}, "events at 5 to 9 µs aren't within start=None and end=8"),
        ({"start": -(2**62)}, f"start must be between -2\\^62 and 2\\^62 µs, not -{2**62}"),
        ({"end": 2**62}, f"end must be between -2\\^62 and 2\\^62 µs, not {2**62}"),
    ],
)
def test_what_is_wrong_with_a_time_range_is_told(bounds, message):
    with pytest.raises(ValueError, match=f"^{message}$"):
        make([5, 9], **bounds)


def test_a_range_is_stated_or_follows_from_the_events():
    ev, stated = make([5, 9]), make([5, 9], start=0, end=20)
    assert (ev.start, ev.end, ev.duration) == (5, 9, 4)
    assert (stated.start, stated.end, stated.duration) == (0, 20, 4)
    assert (stated[:0].start, stated[:0].end, stated[:0].duration) == (0, 20, 0)
    assert (ev[1:].start, ev[1:].end) == (5, 9)
    assert (ev[:0].start, ev[:0].end) == (5, 5)
    assert (Events.empty((3, 3)).start, Events.empty((3, 3)).end) == (0, 0)
    assert (Events.empty((3, 3), -4).end, Events.empty((3, 3), -4, 0).end) == (-4, 0)
    assert ev[5:].sensor_size == (2, 2)


@pytest.mark.parametrize(
    ("window", "lasts", "expected"),
    [
        # without a known end, the window alone says when it begins
        ((None, None), (7, None), (7, None)),
        ((3, 9), (7, None), (3, None)),
        ((3, None), (None, None), (3, None)),
        ((None, 9), (None, None), (None, None)),
        ((None, None), (7, 20), (7, 20)),
        ((None, 9), (7, 20), (7, 8)),
        ((None, 30), (7, 20), (7, 20)),
        ((3, None), (7, 20), (7, 20)),
        ((9, 12), (7, 20), (9, 11)),
        ((9, 9), (7, 20), (9, 9)),
        ((30, 40), (7, 20), (30, 30)),
        ((0, 5), (7, 20), (7, 7)),
        ((3, 9), (None, 20), (3, 8)),
        ((None, 9), (None, 20), (None, 8)),
    ],
)
def test_how_long_windows_last(window, lasts, expected):
    assert bounds_of(*window, *lasts) == expected


def test_nothing_is_copied_that_is_as_wanted():
    ev = make([1, 2, 3])
    again = Events(*ev.columns)
    assert all(np.shares_memory(one, other) for one, other in zip(again.columns, ev.columns, strict=True))
    assert sort_by_time(ev.columns).t is ev.t
    assert concatenate([ev.columns]).t is ev.t
    assert ev.columns.first(3).t is ev.t
    assert ev.columns.first(2).t.tolist() == [1, 2]
    assert ev.window(2, 2).t.tolist() == []
    with pytest.raises(ValueError, match=r"^the window \[5, 4\) ends before it begins$"):
        ev.window(5, 4)


def test_pieces_of_a_stream_are_joined_from_the_first_to_the_last():
    parts = [make([5], start=2, end=6), make([7], start=6, end=8), make([9, 9], start=8, end=20)]
    joined = concatenate_events(parts)
    assert (joined.t.tolist(), joined.start, joined.end) == ([5, 7, 9, 9], 2, 20)
    assert joined.x.tolist() == [0, 0, 0, 1]
    assert joined.sensor_size == (1, 1)


def test_a_mask_selects_and_one_of_another_length_is_refused():
    ev = make(np.arange(70))
    for mask in (np.arange(70) % 3 == 1, np.ones(70, bool), np.zeros(70, bool)):
        assert ev[mask].t.tolist() == np.flatnonzero(mask).tolist()
        assert ev[mask].y.tolist() == np.flatnonzero(mask).tolist()
    for length in (69, 71):
        with pytest.raises(IndexError):
            ev[np.ones(length, bool)]
    # whole numbers are places, not a mask
    assert ev[np.tile([0, 1], 35)].t.tolist() == [0] * 35 + [1] * 35
    assert ev[::-7].t.tolist() == list(range(6, 70, 7))


def test_what_events_are_equal_to():
    ev = make([5, 9])
    assert ev == make([5, 9], start=0)
    assert ev != make([5, 9], sensor_size=(3, 3))
    assert make([5, 9], sensor_size=(3, 3)) != ev
    assert ev != make([5, 8])
    assert ev != Events([5, 9], [0, 1], [0, 1], [0, 1])
    assert ev != ev[:1]
    assert ev != [5, 9]
    assert repr(ev) == "Events(2 events, 4 µs, 2x2)"


@pytest.mark.parametrize(("size", "spread", "used"), [(500, 30, 0), (5_000, 1 << 40, 1), (5_000, 1 << 50, 0)])
def test_many_events_are_sorted_by_digits_and_others_by_comparisons(monkeypatch, size, spread, used):
    by_digits = []
    monkeypatch.setattr(module, "stable_order", lambda t: by_digits.append(t) or np.argsort(t, kind="stable"))
    t = np.random.default_rng(0).integers(spread, 2 * spread, size)
    assert make(t).t.tolist() == sorted(t.tolist())
    assert len(by_digits) == used


@pytest.mark.parametrize("size", [40, 1_500])
@pytest.mark.parametrize("spread", [30, 1 << 45])
@pytest.mark.parametrize("strays", [1, 2, 1_000])
def test_events_in_any_order_are_sorted_stably(size, spread, strays):
    rng = np.random.default_rng(size)
    t = np.sort(rng.integers(-spread, spread, size))
    moved = rng.integers(0, size, min(strays, size // 2))
    t[moved] = t[rng.permutation(moved)] - rng.integers(0, 5, moved.size)
    order = sorted(range(size), key=t.__getitem__)
    ev = make(t)
    assert ev.t.tolist() == sorted(t.tolist())
    assert ev.x.tolist() == ev.y.tolist() == order
