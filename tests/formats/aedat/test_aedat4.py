import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lookalikes import aedat4_bytes, rows
from strategies import events

import nvsdata
from nvsdata import Events, FormatError

kinds = pytest.mark.parametrize("compression", [0, 1, 3], ids=["plain", "lz4", "zstd"])


@kinds
@given(ev=events(max_size=200, width=320, height=240), first=st.integers(0, 2**61))
def test_packets_decode_as_the_description_says(tmp_path, compression, ev, first):
    pytest.importorskip("lz4")
    ev = Events(ev.t + first, ev.x, ev.y, ev.p, (320, 240))
    (tmp_path / "a.aedat4").write_bytes(aedat4_bytes(ev, compression))
    recording = nvsdata.open(tmp_path / "a.aedat4")
    assert recording.read() == ev
    assert recording.read(first + 100, first + 5_000) == ev.window(first + 100, first + 5_000)


@pytest.mark.parametrize(
    ("cut", "reason"),
    [
        (10, "no known|truncated|damaged|does not begin"),
        (16, "damaged"),
        (200, "truncated"),
        (-5, "truncated"),
        (-900, "truncated"),
    ],
)
def test_a_torn_file_names_the_place(tmp_path, cut, reason):
    ev = Events(range(100), range(100), range(100), [1] * 100, (320, 240))
    (tmp_path / "a.aedat4").write_bytes(aedat4_bytes(ev)[:cut])
    with pytest.raises(FormatError, match=reason):
        nvsdata.read(tmp_path / "a.aedat4")
    if cut == -5:
        recording = nvsdata.open(tmp_path / "a.aedat4", strict=False)
        assert len(recording.read()) == 50
        assert recording.repairs


def test_coordinates_outside_are_named(tmp_path):
    ev = Events([1, 2], [5, 6], [5, 5], [0, 1])
    (tmp_path / "a.aedat4").write_bytes(aedat4_bytes(ev, size=(6, 6)))
    with pytest.raises(FormatError, match="event 1: outside the sensor of 6x6"):
        nvsdata.read(tmp_path / "a.aedat4")
    assert nvsdata.read(tmp_path / "a.aedat4", strict=False).t.tolist() == [1]


def test_the_real_file(shared_samples):
    aedat = pytest.importorskip("aedat")
    recording = nvsdata.open(shared_samples / "sample.aedat4")
    ev = recording.read()
    found = list(rows(ev))
    assert recording.sensor_size == (320, 240)
    assert len(found) == 111_954
    assert (found[0], found[-1]) == ((1605537493718345, 154, 204, 0), (1605537494308262, 88, 237, 1))
    start = found[0][0] + 100_000
    assert recording.read(start, start + 30_000) == ev.window(start, start + 30_000)
    theirs = np.concatenate([p["events"] for p in aedat.Decoder(str(recording.path)) if "events" in p])
    for name, field in {"t": "t", "x": "x", "y": "y", "p": "on"}.items():
        assert np.array_equal(getattr(ev, name), theirs[field])


@pytest.mark.parametrize("share", [0.001, 0.5])
def test_a_truncated_file_is_refused_or_read_as_far_as_it_goes(tmp_path, shared_samples, share):
    raw = (shared_samples / "sample.aedat4").read_bytes()
    (tmp_path / "a.aedat4").write_bytes(raw[: int(share * len(raw))])
    with pytest.raises(FormatError, match=r"damaged AEDAT 4|truncated"):
        nvsdata.read(tmp_path / "a.aedat4")
    if share == 0.5:
        assert 0 < len(nvsdata.read(tmp_path / "a.aedat4", strict=False)) < 111_954
