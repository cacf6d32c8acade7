import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lookalikes import AEDAT3_HEADER, aedat3_packet
from strategies import events

import nvsdata
from nvsdata import Events, FormatError

SIZE = (128, 128)


def some(t, size=SIZE):
    n = len(t)
    return Events(t, np.arange(n) % size[0], np.arange(n)[::-1] % size[1], np.arange(n) % 2, size)


@given(events(max_size=200, width=128, height=128), st.integers(0, 2**62 - 400_001))
def test_times_go_round_up_to_2_to_the_62(tmp_path, ev, first):
    ev = Events(ev.t + first, ev.x, ev.y, ev.p, SIZE)
    nvsdata.write(ev, tmp_path / "a.aedat3")
    assert nvsdata.read(tmp_path / "a.aedat3") == ev


def test_other_packets_are_passed_over(tmp_path):
    a, b = some([10, 20]), some([30, 40])
    parts = [
        aedat3_packet(some([15]), kind=0),
        aedat3_packet(a),
        aedat3_packet(some([25] * 9), kind=3),
        aedat3_packet(b),
    ]
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER + b"".join(parts))
    recording = nvsdata.open(tmp_path / "a.aedat")
    assert recording.read().t.tolist() == [10, 20, 30, 40]
    assert recording.span == (10, 40)
    assert recording.sensor_size == SIZE


def test_overflow_counts_the_upper_bits(tmp_path):
    (tmp_path / "a.aedat").write_bytes(
        AEDAT3_HEADER + aedat3_packet(some([2**31 - 5])) + aedat3_packet(some([3]), overflow=1)
    )
    assert nvsdata.read(tmp_path / "a.aedat").t.tolist() == [2**31 - 5, 2**31 + 3]


def test_packets_out_of_order_are_sorted_and_windowed(tmp_path):
    late, early = some([100, 110, 120]), some([50, 105, 106])
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER + aedat3_packet(late) + aedat3_packet(early))
    recording = nvsdata.open(tmp_path / "a.aedat")
    assert recording.read(100, 111).t.tolist() == [100, 105, 106, 110]
    assert recording.read().t.tolist() == [50, 100, 105, 106, 110, 120]


def test_invalid_events_are_dropped_where_the_header_counts_them(tmp_path):
    packet = aedat3_packet(some([1, 2]), valid=False, marked=0) + aedat3_packet(some([3]))
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER + packet)
    assert nvsdata.read(tmp_path / "a.aedat").t.tolist() == [3]


def test_events_without_the_mark_are_kept_with_a_warning_if_the_header_counts_them_valid(tmp_path):
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER + aedat3_packet(some([1, 2]), valid=False))
    with pytest.warns(UserWarning, match="2 events are not marked valid"):
        assert len(nvsdata.read(tmp_path / "a.aedat")) == 2


def test_a_window_decodes_only_its_packets(tmp_path, monkeypatch):
    from nvsdata.formats import aedat3

    t = np.arange(0, 4_000_000, 10)
    nvsdata.write(some(t), tmp_path / "a.aedat3")
    decoded = []
    kernel = aedat3.aedat3_decode
    monkeypatch.setattr(aedat3, "aedat3_decode", lambda *args: decoded.append(args[2]) or kernel(*args))
    window = nvsdata.read(tmp_path / "a.aedat3", 2_000_000, 2_030_000)
    assert window == some(t).window(2_000_000, 2_030_000)
    assert sum(int(packets[:, 1].sum()) for packets in decoded) <= len(window) + 2 * aedat3.PACKET


@pytest.mark.parametrize(
    ("cut", "reason"), [(-3, "truncated within a packet"), (-8 * 3 - 10, "truncated within a packet")]
)
def test_torn_packets_are_named_or_cut(tmp_path, cut, reason):
    raw = AEDAT3_HEADER + aedat3_packet(some([1, 2])) + aedat3_packet(some([3, 4, 5]))
    (tmp_path / "a.aedat").write_bytes(raw[:cut])
    with pytest.raises(FormatError, match=reason):
        nvsdata.read(tmp_path / "a.aedat")
    recording = nvsdata.open(tmp_path / "a.aedat", strict=False)
    assert recording.read().t.tolist() == ([1, 2, 3, 4] if cut == -3 else [1, 2])
    assert recording.repairs


@pytest.mark.parametrize(
    ("at", "value"), [(4, 0), (4, 7), (20, 2**31), (24, 99)], ids=["size 0", "size 7", "number", "valid"]
)
def test_a_header_of_nonsense_is_refused(tmp_path, at, value):
    packet = bytearray(aedat3_packet(some([1, 2])))
    packet[at : at + 4] = value.to_bytes(4, "little")
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER + packet)
    with pytest.raises(FormatError, match="no packet begins here") as caught:
        nvsdata.read(tmp_path / "a.aedat")
    assert caught.value.offset == len(AEDAT3_HEADER)


def test_the_handmade_sample(shared_samples):
    with pytest.warns(UserWarning, match="not marked valid"):
        ev = nvsdata.read(shared_samples / "aedat31_tiny.aedat")
    assert len(ev) == 12
    assert ev.sensor_size == SIZE


@pytest.mark.parametrize("odd", [5, 6, 7])
def test_packets_of_odd_sizes_between(tmp_path, odd):
    from struct import pack

    frame = pack("<HHIIIIII", 2, 1, odd, 0, 0, 1, 1, 1) + bytes(odd)
    parts = [aedat3_packet(some([10, 20])), frame, aedat3_packet(some([30, 40, 50])), frame, aedat3_packet(some([60]))]
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER + b"".join(parts))
    assert nvsdata.read(tmp_path / "a.aedat").t.tolist() == [10, 20, 30, 40, 50, 60]
    assert nvsdata.read(tmp_path / "a.aedat", 30, 45).t.tolist() == [30, 40]
    with pytest.raises(FormatError, match="outside the sensor of 2x128") as caught:
        nvsdata.read(tmp_path / "a.aedat", sensor_size=(2, 128))
    # the third event of the second packet of events
    assert caught.value.offset == len(AEDAT3_HEADER) + (28 + 16) + (28 + odd) + 28 + 16
