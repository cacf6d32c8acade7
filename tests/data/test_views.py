import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import Events
from nvsdata.data.samples import Frame, Inertial, Piece
from nvsdata.data.views import FlippedY, Mapped, Scaled, Slice


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("views")


def recording(folder, ev):
    nvsdata.write(ev, folder / "a.h5")
    return nvsdata.open(folder / "a.h5")


times = st.integers(-1_000, 120_000)


@given(events(max_size=100), times, times, times, times)
def test_a_slice_of_a_recording_is_the_window_of_its_events(folder, ev, a, b, c, d):
    (lo, hi), (start, stop) = sorted((a, b)), sorted((c, d))
    cut = Slice(recording(folder, ev), lo, hi)
    inside = ev.window(lo, hi)
    assert cut.read() == inside
    found = cut.read(start, stop)
    assert found == inside.window(start, stop)
    assert found.start == max(start, lo)
    assert cut.read(start) == inside.window(start)
    assert cut.read(None, stop) == inside.window(None, stop)
    first, last = cut.span
    assert first <= last
    if len(inside):
        assert lo <= first <= inside.t[0] <= inside.t[-1] <= last < hi


@given(events(max_size=100), times)
def test_a_map_is_applied_to_every_window(folder, ev, start):
    mapped = Mapped(recording(folder, ev), lambda events: events[::2])
    assert mapped.read() == ev[::2]
    assert mapped.read(start, start + 500) == ev.window(start, start + 500)[::2]
    assert mapped.sensor_size == ev.sensor_size


@given(events(max_size=100), times)
def test_rows_are_counted_from_the_other_side(folder, ev, start):
    flipped = FlippedY(recording(folder, ev))
    last = ev.sensor_size[1] - 1
    for whole, found in ((ev, flipped.read()), (ev.window(start, start + 500), flipped.read(start, start + 500))):
        assert found.y.tolist() == [last - y for y in whole.y.tolist()]
        assert (found.t.tolist(), found.x.tolist(), found.p.tolist()) == (
            whole.t.tolist(),
            whole.x.tolist(),
            whole.p.tolist(),
        )
    assert FlippedY(flipped).read() == ev


def test_a_slice_that_ends_before_it_begins(folder):
    with pytest.raises(ValueError, match="ends before"):
        Slice(recording(folder, Events([1], [1], [1], [1])), 5, 4)


def test_views_have_the_frames_and_samples_of_what_they_show(tmp_path):
    frames = [Frame(t, t, t + 5, t + 9, 0, 0, np.full((2, 3), t, np.uint16)) for t in (10, 40, 70)]
    times = np.arange(0, 90, 10)
    inertial = Inertial(times, np.zeros((9, 3), np.float32), np.zeros((9, 3), np.float32), np.zeros(9, np.float32))
    piece = Piece.of_camera(Events([5, 50], [1, 1], [1, 1], [0, 1], (4, 4)), frames, inertial, {"serial": "7"})
    nvsdata.write(piece, tmp_path / "a.h5")
    whole = nvsdata.open(tmp_path / "a.h5")
    mapped, cut = Mapped(whole, lambda events: events), Slice(whole, 20, 60)
    assert [frame.start for frame in mapped.frames()] == [10, 40, 70]
    assert mapped.about["serial"] == "7"
    assert [frame.start for frame in cut.frames()] == [40]
    assert cut.inertial().t.tolist() == [20, 30, 40, 50]
    assert cut.inertial(30, 100).t.tolist() == [30, 40, 50]
    assert not Scaled(whole, 10).holds_samples
