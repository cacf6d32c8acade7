import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import Events, FormatError


@given(events(max_size=60), st.integers(-(2**62), 2**62 - 200_000))
def test_times_up_to_2_to_the_62_go_round(tmp_path, ev, first):
    late = Events(ev.t + first, ev.x, ev.y, ev.p, ev.sensor_size)
    nvsdata.write(late, tmp_path / "a.h5")
    assert nvsdata.read(tmp_path / "a.h5") == late


@pytest.fixture
def path(tmp_path):
    n = 1_000
    nvsdata.write(
        Events(np.arange(n), np.arange(n) % 30, np.arange(n) % 20, np.arange(n) % 2, (30, 20)), tmp_path / "a.h5"
    )
    return tmp_path / "a.h5"


def test_a_compressed_copy_reads_the_same(path, tmp_path):
    with h5py.File(path) as old, h5py.File(tmp_path / "b.h5", "w") as new:
        new.attrs.update(old.attrs)
        for name in "txyp":
            new.create_dataset(f"events/{name}", data=old[f"events/{name}"][:], chunks=(64,), compression="gzip")
    assert nvsdata.read(tmp_path / "b.h5") == nvsdata.read(path)
    assert nvsdata.read(tmp_path / "b.h5", 100, 300) == nvsdata.read(path, 100, 300)


def test_a_truncated_file_is_refused(path):
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(FormatError, match=r"truncated|damaged"):
        nvsdata.read(path)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda f: f.attrs.pop("format"), "without the attribute"),
        (lambda f: f.attrs.update(version=99), "newer"),
        (lambda f: f.attrs.update(width=0), "sensor_size"),
        (lambda f: f.pop("events/p"), "damaged"),
        (lambda f: (f.pop("events/p"), f.create_dataset("events/p", data=np.zeros(3, np.uint8))), "different lengths"),
        (lambda f: f["events/x"].write_direct(np.full(1000, 31, np.int16)), "outside the sensor"),
    ],
)
def test_damage_is_named(path, change, reason):
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(FormatError, match=reason):
        nvsdata.read(path)
