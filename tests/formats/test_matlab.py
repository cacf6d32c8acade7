import io
import struct
import zlib

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from lookalikes import MATLAB_73, hdf5_bytes, matlab_bytes
from strategies import events

import nvsdata
from nvsdata import Events, FormatError

SIZE = (240, 180)
EV = Events([5, 9, 9], [0, 100, 239], [0, 80, 179], [1, 0, 1], SIZE)


@pytest.mark.parametrize("compress", [True, False])
@given(ev=events(max_size=100, width=240, height=180))
def test_columns_of_a_v5_file(tmp_path, compress, ev):
    (tmp_path / "a.mat").write_bytes(matlab_bytes(ev, compress))
    recording = nvsdata.open(tmp_path / "a.mat", sensor_size=SIZE)
    if len(ev) and ev.x.min() >= 1 and ev.y.min() >= 1 and (ev.x.max() == 240 or ev.y.max() == 180):
        return
    assert recording.read() == ev


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.int32, np.float64, np.float32])
def test_columns_of_any_numeric_type(tmp_path, kind):
    more = {"x": EV.x.astype(kind), "y": EV.y.astype(kind), "ts": EV.t.astype(np.float64)}
    (tmp_path / "a.mat").write_bytes(matlab_bytes(EV, **more))
    assert nvsdata.read(tmp_path / "a.mat", sensor_size=SIZE) == EV


def test_polarity_of_either_sign_and_coordinates_from_one(tmp_path):
    shifted = {"x": EV.x + 1, "y": EV.y + 1, "pol": np.where(EV.p == 1, 1, -1).astype(np.int8)}
    (tmp_path / "a.mat").write_bytes(matlab_bytes(EV, **shifted))
    assert nvsdata.read(tmp_path / "a.mat", sensor_size=SIZE) == EV


def test_a_struct_of_columns(tmp_path):
    file = io.BytesIO()
    scipy.io.savemat(file, {"TD": {"ts": EV.t, "x": EV.x, "y": EV.y, "p": EV.p}}, do_compression=True)
    (tmp_path / "a.mat").write_bytes(file.getvalue())
    assert nvsdata.read(tmp_path / "a.mat", sensor_size=SIZE) == EV


V73 = {
    name: {"data": column.reshape(1, -1).astype(np.float64)}
    for name, column in {"ts": EV.t, "x": EV.x, "y": EV.y, "pol": EV.p}.items()
}
HUGE = {"shape": (10**12,), "dtype": "u4", "chunks": (1_000,)}


def test_a_v73_file(tmp_path):
    # what else is in the file isn't looked at
    (tmp_path / "a.mat").write_bytes(hdf5_bytes(V73 | {"other": HUGE}, MATLAB_73))
    assert nvsdata.read(tmp_path / "a.mat", sensor_size=SIZE) == EV


def test_a_v73_file_that_lacks_what_it_claims(tmp_path):
    (tmp_path / "a.mat").write_bytes(hdf5_bytes(V73 | {"ts": HUGE}, MATLAB_73))
    with pytest.raises(FormatError, match="0 of 1000000000 pieces of /ts are there"):
        nvsdata.read(tmp_path / "a.mat", sensor_size=SIZE)


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ({"x": np.array([0, 1])}, "different lengths"),
        ({"x": np.array([0, 1.5, 2])}, "aren't whole"),
        ({"ts": np.array([0, np.nan, 2])}, "aren't whole"),
        ({"pol": np.array([0, 3, 1])}, "event 1: outside"),
        ({"y": np.array([0, 181, 1])}, "event 1: outside the sensor of 240x180"),
    ],
)
def test_damage_is_named(tmp_path, more, reason):
    (tmp_path / "a.mat").write_bytes(matlab_bytes(EV, **more))
    with pytest.raises(FormatError, match=reason):
        nvsdata.read(tmp_path / "a.mat", sensor_size=SIZE)


def test_a_missing_column_is_named(tmp_path):
    file = io.BytesIO()
    scipy.io.savemat(file, {"x": EV.x, "y": EV.y})
    (tmp_path / "a.mat").write_bytes(file.getvalue())
    with pytest.raises(FormatError, match=r"no variable 'ts'; the file has \['x', 'y'\]"):
        nvsdata.read(tmp_path / "a.mat")


@pytest.mark.parametrize("length", [100, 127, 140, 200])
def test_a_truncated_file_is_refused(tmp_path, length):
    (tmp_path / "a.mat").write_bytes(matlab_bytes(EV)[:length])
    with pytest.raises(FormatError):
        nvsdata.read(tmp_path / "a.mat")


def test_without_strict_events_outside_are_dropped_and_counted(tmp_path):
    (tmp_path / "a.mat").write_bytes(matlab_bytes(EV, y=np.array([0, 200, 1])))
    recording = nvsdata.open(tmp_path / "a.mat", sensor_size=SIZE, strict=False)
    assert recording.read().t.tolist() == [5, 9]
    assert recording.repairs == {"events outside the sensor, dropped": 1}


def test_a_small_file_that_inflates_to_gigabytes_is_refused(tmp_path):
    """What inflates it stops at the bound, whatever an element or all of them together come to."""
    small = matlab_bytes(EV)
    for sizes in ((1 << 27,), (1 << 25,) * 3):
        bodies = [zlib.compress(struct.pack("<II", 14, size) + bytes(size)) for size in sizes]
        elements = b"".join(struct.pack("<II", 15, len(body)) + body for body in bodies)
        (tmp_path / "a.mat").write_bytes(small[:128] + elements + small[128:])
        assert (tmp_path / "a.mat").stat().st_size < sum(sizes) / 900
        with pytest.raises(FormatError, match=r"expands too far: a file of .* may expand to 67108864 at most"):
            nvsdata.read(tmp_path / "a.mat", sensor_size=SIZE)


def test_events_that_compress_well_are_read(tmp_path):
    n = 400_000
    ev = Events(np.arange(n), np.zeros(n, int), np.zeros(n, int), np.ones(n, int), SIZE)
    columns = {name: getattr(ev, name[0]).astype(float) for name in ("x", "y", "pol")}
    (tmp_path / "a.mat").write_bytes(matlab_bytes(ev, **columns))
    assert nvsdata.read(tmp_path / "a.mat", sensor_size=SIZE) == ev


@pytest.mark.parametrize("value", [2**62, -(2**62), 2**63, 2**64 - 1])
@pytest.mark.parametrize("how", ["v5", "v7.3"])
def test_times_from_2_to_the_62_are_refused(tmp_path, how, value):
    times = np.array([1, 2, value], np.uint64 if value > 0 else np.int64)
    raw = matlab_bytes(EV, ts=times) if how == "v5" else hdf5_bytes(V73 | {"ts": {"data": times}}, MATLAB_73)
    (tmp_path / "a.mat").write_bytes(raw)
    for strict in (True, False):
        with pytest.raises(FormatError, match=r"'t' has numbers beyond 2\^62"):
            nvsdata.read(tmp_path / "a.mat", sensor_size=SIZE, strict=strict)


def test_a_struct_of_columns_in_a_v73_file(tmp_path):
    raw = hdf5_bytes({f"TD/{name}": how for name, how in V73.items()} | {"#refs#/x": {"data": 1.0}}, MATLAB_73)
    (tmp_path / "a.mat").write_bytes(raw)
    assert nvsdata.read(tmp_path / "a.mat", sensor_size=SIZE) == EV


def test_a_file_that_changes_after_it_was_opened_is_refused(tmp_path):
    ev = Events(np.arange(20_000), np.arange(20_000) % 240, np.arange(20_000) % 180, np.arange(20_000) % 2, SIZE)
    (tmp_path / "a.mat").write_bytes(matlab_bytes(ev, compress=False))
    recording = nvsdata.open(tmp_path / "a.mat", sensor_size=SIZE)
    (tmp_path / "a.mat").write_bytes(matlab_bytes(ev[::-1], compress=False))
    with pytest.raises(FormatError, match="changed after it was opened"):
        recording.read()
