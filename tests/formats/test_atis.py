import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lookalikes import atis_bytes
from strategies import events

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats import atis


def slow_decode(raw: bytes):
    """Record by record, from the format's description."""
    offset, out = 0, []
    for i in range(0, len(raw), 5):
        x, y, b2, b3, b4 = raw[i : i + 5]
        if y == 240:
            offset += 8192
        if y >= 240:
            continue
        out.append((offset + ((b2 & 0x7F) << 16 | b3 << 8 | b4), x, y, b2 >> 7))
    return sorted(out, key=lambda event: event[0])


@given(st.binary(max_size=2_000).map(lambda b: b[: len(b) // 5 * 5]))
def test_any_bytes_decode_as_the_description_says(tmp_path, raw):
    path = tmp_path / "a.bin"
    path.write_bytes(raw)
    recording = nvsdata.open(path, strict=False)
    ev = recording.read()
    assert list(zip(ev.t, ev.x, ev.y, ev.p, strict=True)) == slow_decode(raw)
    damaged = np.flatnonzero(np.frombuffer(raw[1::5], np.uint8) > 240)
    assert recording.repairs.get("records of y above 240, dropped", 0) == damaged.size
    if damaged.size:
        with pytest.raises(FormatError, match="is damage, because events have y below 240") as caught:
            nvsdata.read(path)
        assert caught.value.offset == 5 * damaged[0]
    else:
        assert nvsdata.read(path) == ev


@given(events(max_size=50), st.integers(0, 2**33 - 200_000))
def test_long_times_go_round_through_overflow_records(tmp_path, ev, first):
    ev = Events(ev.t + first % 2**27, ev.x, ev.y, ev.p, ev.sensor_size)
    path = tmp_path / "a.bin"
    nvsdata.write(ev, path)
    assert nvsdata.read(path, sensor_size=ev.sensor_size) == ev
    assert nvsdata.read(path, int(ev.t[0]) if len(ev) else 0, sensor_size=ev.sensor_size) == ev


def test_windows_across_overflow_records(tmp_path):
    t = np.arange(0, 40_000_000, 5_000)
    ev = Events(t, t % 34, t % 30, t % 2, (34, 34))
    path = tmp_path / "a.bin"
    nvsdata.write(ev, path)
    recording = nvsdata.open(path, sensor_size=(34, 34))
    for start in (0, 8_388_000, 12_345_678, 39_990_000):
        assert recording.read(start, start + 30_000) == ev.window(start, start + 30_000)
    assert recording.span == (0, 39_995_000)
    assert recording._whole is None
    assert recording.anomalies()["time overflow records"] > 0


def test_a_truncated_file_names_the_byte(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(atis_bytes(*(np.array([1, 2, 3]),) * 3, np.array([0, 1, 0]))[:-2])
    with pytest.raises(FormatError, match=r"a.bin: byte 10: truncated: 3 bytes") as caught:
        nvsdata.open(path)
    assert caught.value.offset == 10


def test_an_empty_file_holds_no_events(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"")
    recording = nvsdata.open(tmp_path / "a.bin")
    assert len(recording.read()) == 0
    assert len(recording.read(0, 10)) == 0
    assert recording.span == (0, 0)


def test_a_coordinate_outside_names_its_byte(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(atis_bytes(np.array([1, 2, 3]), np.array([1, 50, 2]), np.array([1, 1, 1]), np.array([0, 1, 0])))
    with pytest.raises(FormatError) as caught:
        nvsdata.read(path, sensor_size=(34, 34))
    assert caught.value.offset == 5


def test_unsorted_times_are_sorted_and_counted(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(atis_bytes(np.array([9, 5, 5, 7]), *(np.array([1, 2, 2, 3]),) * 2, np.array([0, 1, 1, 0])))
    recording = nvsdata.open(path)
    assert recording.read().t.tolist() == [5, 5, 7, 9]
    assert recording.read(6, 9).t.tolist() == [7]
    assert recording.anomalies() == {"steps back in time": 1, "duplicate events": 1, "time overflow records": 0}


@pytest.mark.parametrize(
    ("t", "x", "y"), [(-1, 1, 1), (2**33, 1, 1), (1, 256, 1), (1, 1, 240)], ids=["before 0", "late", "x", "y"]
)
def test_what_does_not_fit_is_refused(tmp_path, t, x, y):
    with pytest.raises(ValueError, match="ATIS"):
        nvsdata.write(Events([t], [x], [y], [1]), tmp_path / "a.bin")
    assert not list(tmp_path.iterdir())


def spread(times, y=7):
    """Records of one pixel, x = 3, at these times."""
    return b"".join(bytes([3, y]) + time.to_bytes(3, "big") for time in times)


@pytest.mark.parametrize(
    ("raw", "seems"),
    [
        (spread(range(16)), True),
        (spread(range(15)), False),
        (spread(range(16)) + b"\0", False),
        (spread([5] * 16), False),
        (spread([5] * 15 + [6]), True),
        (spread([5] * 8 + [4] + [9] * 8), False),
        (spread([0, *range(15), 13]), False),
        (spread([9, *range(9, 30)]), True),
        (spread([9, *range(8, 30)]), False),
        (spread([*range(255), 0]), False),
        (spread([*range(256), 0]), True),
        # the uppermost bit is the polarity
        (spread([time | (time % 2) << 23 for time in range(20)]), True),
        *((spread([*range(20), low, low + 1]), True) for low in (0xFF, 0xFFFF, 0x1FFFF, 0x3FFFFF)),
        (spread([*range(20), 0xFF00, 0x10000]), True),
        (spread(range(20), y=240), True),
        (spread(range(20), y=241), False),
        (spread(range(20)) + spread([20], y=241), False),
    ],
)
def test_what_begins_with_records_whose_times_rise_seems_to_be_atis(raw, seems):
    assert atis.looks_like(raw, len(raw)) is seems


def test_real_recordings_decode_as_the_description_says(real_nmnist):
    for path in sorted(real_nmnist.glob("Train/*/*.bin"))[::50]:
        ev = nvsdata.read(path, sensor_size=(34, 34))
        assert list(zip(ev.t, ev.x, ev.y, ev.p, strict=True)) == slow_decode(path.read_bytes())
        assert nvsdata.read(path, 100_000, 130_000, sensor_size=(34, 34)) == ev.window(100_000, 130_000)
