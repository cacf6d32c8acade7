import numpy as np
import pytest
from hypothesis import given
from strategies import events

import nvsdata
from nvsdata import Events, FormatError

HEADER = b"% Data file containing CD events.\n% Version 2\n"


def dat(t, address, header=HEADER, kind=b"\x00\x08"):
    words = np.stack([np.asarray(t, "<u4"), np.asarray(address, "<u4")], 1)
    return header + kind + words.tobytes()


def test_version_2_fields(tmp_path):
    path = tmp_path / "a.dat"
    path.write_bytes(dat([5, 7], [3 | 9 << 14 | 1 << 28, 300 | 200 << 14]))
    ev = nvsdata.read(path)
    assert (ev.t.tolist(), ev.x.tolist(), ev.y.tolist(), ev.p.tolist()) == ([5, 7], [3, 300], [9, 200], [1, 0])


def test_version_1_fields(tmp_path):
    path = tmp_path / "a.dat"
    path.write_bytes(dat([5, 7], [3 | 9 << 9 | 1 << 17, 300 | 200 << 9], header=b"% old\n"))
    ev = nvsdata.read(path)
    assert (ev.x.tolist(), ev.y.tolist(), ev.p.tolist()) == ([3, 300], [9, 200], [1, 0])


@pytest.mark.parametrize("size", [None, (304, 240)])
def test_a_polarity_of_four_bits_is_damage(tmp_path, size):
    path = tmp_path / "a.dat"
    path.write_bytes(dat([5, 6, 7], [3 | 1 << 28, 4 | 8 << 28, 5]))
    with pytest.raises(FormatError, match=r"polarity other than 0 and 1") as found:
        nvsdata.read(path, sensor_size=size)
    assert found.value.offset == len(HEADER) + 2 + 8
    recording = nvsdata.open(path, sensor_size=size, strict=False)
    assert recording.read().x.tolist() == [3, 5]
    assert sum(recording.repairs.values()) == 1


@given(events(max_size=3_000, gap=30))
def test_times_beyond_32_bits_go_round(tmp_path, ev):
    first = 2**32 - 20_000
    long = Events(ev.t + first - ev.t.min(initial=2**40), ev.x, ev.y, ev.p, ev.sensor_size) if len(ev) else ev
    if len(long):
        long = Events(long.t - long.t[0] + first, ev.x, ev.y, ev.p, ev.sensor_size)
    path = tmp_path / "a.dat"
    nvsdata.write(long, path)
    assert nvsdata.read(path) == long
    assert nvsdata.read(path, 2**32, 2**32 + 5_000) == long.window(2**32, 2**32 + 5_000)


def test_several_wraps_are_unwound(tmp_path):
    t = np.arange(0, 5 * 2**32, 2**18)
    ev = Events(t, t % 7, t % 5, t % 2, (10, 10))
    path = tmp_path / "a.dat"
    nvsdata.write(ev, path)
    assert nvsdata.read(path) == ev
    assert nvsdata.read(path, 3 * 2**32, 4 * 2**32) == ev.window(3 * 2**32, 4 * 2**32)
    assert nvsdata.open(path).span == (0, int(t[-1]))


@pytest.mark.parametrize(
    ("content", "offset", "reason"),
    [
        (HEADER, len(HEADER), "no event type"),
        (HEADER + b"\x0c\x08abc", len(HEADER) + 2, "truncated"),
        (HEADER + b"\x0e\x08", len(HEADER), "not a change-detection"),
        (HEADER + b"\x00\x10", len(HEADER), "16 bytes"),
    ],
)
def test_broken_headers_name_the_byte(tmp_path, content, offset, reason):
    (tmp_path / "a.dat").write_bytes(content)
    with pytest.raises(FormatError, match=reason) as caught:
        nvsdata.open(tmp_path / "a.dat")
    assert caught.value.offset == offset


def test_the_sensor_of_the_header_is_believed(tmp_path):
    path = tmp_path / "a.dat"
    path.write_bytes(dat([5], [3 | 9 << 14], header=HEADER + b"% Width 8\n% Height 8\n"))
    assert nvsdata.open(path).sensor_size == (8, 8)
    with pytest.raises(FormatError, match="outside the sensor of 8x8"):
        nvsdata.read(path)


def test_gaps_that_no_reader_can_unwind_are_refused(tmp_path):
    with pytest.raises(ValueError, match="gaps below"):
        nvsdata.write(Events([0, 2**31], [1, 1], [1, 1], [1, 1]), tmp_path / "a.dat")


def test_local_disorder_is_sorted(tmp_path):
    path = tmp_path / "a.dat"
    path.write_bytes(dat([5, 9, 7, 8, 20], [1, 2, 3, 4, 5]))
    assert nvsdata.read(path).t.tolist() == [5, 7, 8, 9, 20]
    assert nvsdata.read(path, 7, 9).x.tolist() == [3, 4]


def test_a_real_ncars_recording(shared_samples):
    ev = nvsdata.read(shared_samples / "sample_ncars.dat")
    assert len(ev) == 2009
    assert [(c[0], c[-1]) for c in ev.columns] == [(0, 99952), (25, 75), (8, 28), (0, 1)]


def test_the_real_file_agrees_with_expelliarmus(shared_samples):
    expelliarmus = pytest.importorskip("expelliarmus")
    path = shared_samples / "sample_ncars.dat"
    theirs = expelliarmus.Wizard("dat", fpath=str(path)).read()
    ours = nvsdata.read(path)
    for name in ("t", "x", "y", "p"):
        assert np.array_equal(getattr(ours, name), theirs[name])
