import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats import npy

SIZE = (240, 180)
EV = Events([5, 9, 9, 2_000_005], [0, 100, 239, 1], [0, 80, 179, 1], [1, 0, 1, 1], SIZE)


def saved(path, array):
    np.save(path / "a.npy", array)
    return path / "a.npy"


@given(ev=events(max_size=60, width=240, height=180))
def test_what_is_written_is_read(tmp_path, ev):
    nvsdata.write(ev, tmp_path / "a.npy")
    assert nvsdata.read(tmp_path / "a.npy", sensor_size=ev.sensor_size) == ev
    assert np.array_equal(np.load(tmp_path / "a.npy"), ev.to_structured())


def test_pieces_are_joined(tmp_path):
    nvsdata.write(iter([EV[:1], EV[1:3], EV[3:]]), tmp_path / "a.npy")
    assert nvsdata.read(tmp_path / "a.npy", sensor_size=SIZE) == EV
    assert len(np.load(tmp_path / "a.npy")) == 4


@pytest.mark.parametrize("order", ["xytp", "xypt"])
@pytest.mark.parametrize("kind", [np.int32, np.int64, np.uint32, np.float32, np.float64])
@pytest.mark.parametrize("transposed", [False, True])
def test_columns_without_names(tmp_path, order, kind, transposed):
    columns = [getattr(EV, name).astype(kind) for name in order]
    array = np.stack(columns).T if transposed else np.stack(columns, 1)
    assert array.flags.c_contiguous != transposed
    assert nvsdata.read(saved(tmp_path, array), sensor_size=SIZE) == EV


@pytest.mark.parametrize(
    "names",
    [
        [("x", "u2"), ("y", "u2"), ("p", "?"), ("t", "i8")],
        [("timestamp", "u8"), ("x", "i4"), ("y", "i4"), ("polarity", "i1")],
        [("ts", "f8"), ("extra", "f4"), ("Y", "u1"), ("X", "u1"), ("pol", "u1")],
    ],
)
@pytest.mark.parametrize("aligned", [False, True])
def test_fields_by_any_name_and_type(tmp_path, names, aligned):
    array = np.zeros(4, np.dtype(names, align=aligned))
    for field, _ in names:
        if field != "extra":
            array[field] = getattr(EV, field[0].lower())
    assert nvsdata.read(saved(tmp_path, array), sensor_size=SIZE) == EV


def test_seconds_and_signed_polarity(tmp_path):
    array = np.stack([EV.x, EV.y, EV.t / 1e6, np.where(EV.p == 1, 1, -1)], 1)
    assert nvsdata.read(saved(tmp_path, array), sensor_size=SIZE) == EV


@given(st.data())
def test_a_window_is_that_of_the_whole(tmp_path, data):
    ev = Events(np.arange(20_000) * 3, np.arange(20_000) % 240, np.arange(20_000) % 180, np.arange(20_000) % 2, SIZE)
    path = saved(tmp_path, np.stack([ev.x, ev.y, ev.p, ev.t], 1))
    a, b = sorted(data.draw(st.tuples(st.integers(-5, 60_005), st.integers(-5, 60_005))))
    assert nvsdata.read(path, a, b, sensor_size=SIZE) == ev.window(a, b)


def test_a_window_decodes_little_of_a_long_file(tmp_path, monkeypatch):
    ev = Events(np.arange(200_000), np.zeros(200_000, int), np.zeros(200_000, int), np.zeros(200_000, int), SIZE)
    nvsdata.write(ev, tmp_path / "a.npy")
    recording = nvsdata.open(tmp_path / "a.npy", sensor_size=SIZE)
    decoded = []
    whole = npy.NpyRecording._between
    monkeypatch.setattr(npy.NpyRecording, "_between", lambda self, a, b: decoded.append(b - a) or whole(self, a, b))
    assert recording.span == (0, 199_999)
    assert recording.read(100_000, 100_500) == ev.window(100_000, 100_500)
    assert sum(decoded) <= 8 * npy.NpyRecording.block


@pytest.mark.parametrize(
    ("array", "reason"),
    [
        (np.zeros((3, 5)), r"shape \(3, 5\)"),
        (np.zeros(7), r"shape \(7,\)"),
        (np.zeros((3, 4), complex), "complex128, not of numbers"),
        (np.array([["a"] * 4]), "not of numbers"),
        (np.array([[1, 2, 5, 5]]), "neither the third nor the fourth"),
        (np.zeros(2, [("t", "i8"), ("x", "i2"), ("p", "i1")]), r"no field 'y'; the array has \['t', 'x', 'p'\]"),
        (np.array([[1, 2.5, 5, 1]]), "column 'y' has numbers that aren't whole"),
        (np.array([[1, 2, np.nan, 1]]), "not numbers"),
        (np.array([[1, 2, 2**62, 1]]), r"beyond 2\^62"),
        (np.array([[1, 2, 3, 0], [240, 2, 3, 0]]), "event 1: outside the sensor of 240x180"),
    ],
)
def test_damage_is_named(tmp_path, array, reason):
    with pytest.raises(FormatError, match=reason):
        nvsdata.read(saved(tmp_path, array), sensor_size=SIZE)


def test_pickled_objects_are_not_run(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{}, 1, "x"], object), allow_pickle=True)
    with pytest.raises(FormatError, match="not of numbers"):
        nvsdata.read(tmp_path / "a.npy")


@pytest.mark.parametrize("length", [0, 5, 8, 40, 127, 128, 130, 141])
def test_a_truncated_file_is_refused(tmp_path, length):
    nvsdata.write(EV, tmp_path / "a.npy")
    raw = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(raw[:length])
    with pytest.raises(FormatError):
        nvsdata.read(tmp_path / "a.npy", sensor_size=SIZE)


def test_without_strict_what_is_whole_is_read(tmp_path):
    nvsdata.write(EV, tmp_path / "a.npy")
    raw = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(raw[:-20])
    recording = nvsdata.open(tmp_path / "a.npy", sensor_size=SIZE, strict=False)
    assert recording.read() == EV[:2]
    assert recording.repairs == {"bytes of a torn record, cut off": 6, "events that are cut off": 2}
    np.save(tmp_path / "a.npy", np.array([[1, 2, 3, 0], [240, 2, 3, 0]]))
    recording = nvsdata.open(tmp_path / "a.npy", sensor_size=SIZE, strict=False)
    assert len(recording.read()) == 1
    assert recording.repairs == {"events outside the sensor, dropped": 1}


def test_no_events(tmp_path):
    for array in (np.zeros((0, 4)), np.zeros((4, 0)).T, np.zeros(0, npy.STRUCTURE)):
        recording = nvsdata.open(saved(tmp_path, array), sensor_size=SIZE)
        assert (len(recording.read()), recording.span) == (0, (0, 0))
