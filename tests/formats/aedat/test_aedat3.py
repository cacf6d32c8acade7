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
    from nvsdata.formats.aedat import aedat3

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


def test_version_3_0_counts_rows_from_the_bottom(tmp_path):
    packet = aedat3_packet(Events([1, 2, 3], [5, 6, 7], [0, 100, 179], [1, 0, 1], (240, 180)))
    for source, options in ((b"davis240c", {}), (b"what", {"sensor_size": (240, 180)})):
        (tmp_path / "a.aedat").write_bytes(b"#!AER-DAT3.0\r\n#Source 1: " + source + b"\r\n" + packet)
        recording = nvsdata.open(tmp_path / "a.aedat", **options)
        assert recording.sensor_size == (240, 180)
        assert recording.read().y.tolist() == [179, 79, 0]
        assert recording.read(2, 4).y.tolist() == [79, 0]
    with pytest.raises(FormatError, match=r"byte 0: AEDAT 3\.0 of an unknown camera counts y from the bottom"):
        nvsdata.open(tmp_path / "a.aedat")


@pytest.mark.parametrize(
    ("source", "size"),
    [
        (b"DVS128", (128, 128)),
        (b"davis346bred", (346, 260)),
        (b"DVXplorer_", (640, 480)),
        (b"NVSDATA-7x5", (7, 5)),
        (b"myDVS128", None),
        (b"nvsdata-7x5x", None),
    ],
)
def test_the_source_tells_the_sensor(tmp_path, source, size):
    header = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 12: " + source + b"\r\n#!End-Header\r\n"
    (tmp_path / "a.aedat").write_bytes(header + aedat3_packet(Events([1], [3], [4], [1], (7, 5))))
    # else the smallest that holds the events
    assert nvsdata.open(tmp_path / "a.aedat").sensor_size == (size or (4, 5))
    assert nvsdata.open(tmp_path / "a.aedat", sensor_size=(99, 98)).sensor_size == (99, 98)


@pytest.mark.parametrize("header", [b"#!AER-DAT3.1\r\n", b"#!AER-DAT3.1\r\n#Source 1: DVS128\r\n"])
def test_a_header_without_its_last_line_is_refused(tmp_path, header):
    (tmp_path / "a.aedat").write_bytes(header)
    with pytest.raises(FormatError, match="the header has no line #!END-HEADER") as caught:
        nvsdata.open(tmp_path / "a.aedat")
    assert caught.value.offset == len(header)


def test_no_packets_and_packets_without_times_that_count(tmp_path):
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER)
    recording = nvsdata.open(tmp_path / "a.aedat")
    assert (recording.span, len(recording.read()), len(recording.read(0, 9))) == ((0, 0), 0, 0)
    assert recording._whole is None
    # the first and the last event of a packet may be invalid
    invalid = aedat3_packet(some([0, 10, 20, 900]), marked=2)
    raw = bytearray(invalid)
    for at in (28, 28 + 24):
        raw[at] &= 0xFE
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER + aedat3_packet(some([5, 15])) + raw)
    recording = nvsdata.open(tmp_path / "a.aedat")
    assert recording.span == (5, 20)
    assert recording.read(10, 16).t.tolist() == [10, 15]
    assert recording.read().t.tolist() == [5, 10, 15, 20]


STRAY = "a packet with events before its first, after its last, or before time 0"


@pytest.mark.parametrize(
    ("times", "kept"),
    [
        ([5_000, 4_000, 6_000], [4_000, 5_000, 6_000]),
        ([5_000, 7_000, 6_000], [5_000, 6_000, 7_000]),
        ([5_000, 5_100, 3_999, 6_000, 6_100], [5_000, 5_100, 6_000, 6_100]),
        ([5_000, 5_100, 7_101, 5_200, 5_300, 6_100], [5_000, 5_100, 5_200, 5_300, 6_100]),
        ([5_000, 5_100, 99_000, 5_300, 2**31 - 1, 5_400], [5_000, 5_100, 5_300, 5_400]),
        ([2**32 - 1], []),
        ([5_000, 2**32 - 1, 5_100], [5_000, 5_100]),
    ],
)
@pytest.mark.parametrize("overflow", [0, 3])
def test_events_far_from_their_packets_ends_are_told_or_dropped(tmp_path, times, kept, overflow):
    # Events would sort them
    mixed = Events.trusted(some(range(len(times))).columns._replace(t=np.array(times)), SIZE)
    before, packet, after = (aedat3_packet(ev, overflow=overflow) for ev in (some([100, 200]), mixed, some([9_000])))
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER + before + packet + after)
    repaired = nvsdata.open(tmp_path / "a.aedat", strict=False)
    begin = overflow << 31
    assert repaired.read().t.tolist() == [begin + t for t in (100, 200, *kept, 9_000)]
    lost = len(times) - len(kept)
    assert repaired.repairs.get("events of times that fit no packet, dropped", 0) == lost
    columns = {t: x for x, t in enumerate(times)}
    assert repaired.read().x.tolist() == [0, 1, *(columns[t] for t in kept), 0]
    if lost:
        with pytest.raises(FormatError, match=STRAY) as caught:
            nvsdata.read(tmp_path / "a.aedat")
        assert caught.value.offset == len(AEDAT3_HEADER) + len(before)
    else:
        assert nvsdata.read(tmp_path / "a.aedat").t.tolist() == [begin + t for t in (100, 200, *kept, 9_000)]


@pytest.mark.parametrize("piece", [64, 500, 4_096, 1 << 20])
def test_packets_are_read_in_pieces_of_any_size(tmp_path, monkeypatch, piece):
    monkeypatch.setattr("nvsdata.formats.aedat.aedat3.PIECE", piece)
    parts = [some(range(100 * k, 100 * k + n)) for k, n in enumerate((1, 40, 3, 0, 99, 2, 2, 60))]
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER + b"".join(aedat3_packet(part) for part in parts))
    recording = nvsdata.open(tmp_path / "a.aedat")
    assert recording.read().t.tolist() == [t for part in parts for t in part.t.tolist()]
    sizes = []
    ranges = recording._contents.ranges
    recording._contents.ranges = lambda wanted: sizes.extend(stop - start for start, stop in wanted) or ranges(wanted)
    assert len(recording.read()) == 207
    # half a piece, and what of the last packet reaches beyond
    assert max(sizes) <= piece // 2 + 8 * 99
    assert len(sizes) == (1 if piece > 4_096 else len(sizes))
    assert recording.read(405, 550).t.tolist() == [*range(405, 499), 500, 501]


def test_the_span_has_events_before_a_packets_first_and_after_its_last(tmp_path):
    times = np.array([5_000, 4_000, 4_500, 6_500, 6_900, 6_000])
    packet = aedat3_packet(Events.trusted(some(range(6)).columns._replace(t=times), SIZE))
    (tmp_path / "a.aedat").write_bytes(AEDAT3_HEADER + packet)
    recording = nvsdata.open(tmp_path / "a.aedat")
    assert recording.span == (4_000, 6_900)
    assert recording._whole is None
