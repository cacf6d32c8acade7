"""AEDAT 4: windows by the table at the end, and writing."""

import sys

import numpy as np
import pytest
from flatbuffers import aedat4_file
from hypothesis import given
from hypothesis import strategies as st
from lookalikes import aedat4_events
from strategies import events

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats.aedat import aedat4_packets

SIZE = (320, 240)


def listed(parts, begin, change=lambda rows: rows):
    """Rows of the table for uncompressed packets of events."""
    rows, at = [], begin
    for ev in parts:
        size = len(aedat4_events(ev))
        rows.append([at + 8, 0, size, len(ev), int(ev.t[0]), int(ev.t[-1])])
        at += 8 + size
    return change(rows)


def written(path, parts, change=lambda rows: rows):
    """A recording of packets of events, and a table of them that `change` alters."""
    packets = [("EVTS", aedat4_events(ev)) for ev in parts]
    path.write_bytes(aedat4_file(packets, table=lambda begin: listed(parts, begin, change)))
    return nvsdata.open(path, sensor_size=SIZE)


def two_parts():
    a = Events(range(1_000, 1_100), range(100), range(100), [1] * 100, SIZE)
    b = Events(range(2_000, 2_100), range(100), range(100), [0] * 100, SIZE)
    return a, b, Events(*map(np.concatenate, zip(a.columns, b.columns, strict=True)), SIZE)


@given(
    ev=events(max_size=400, width=320, height=240).filter(len),
    first=st.integers(-(2**60), 2**60),
    start=st.integers(-100, 40_000),
    length=st.integers(0, 20_000),
)
def test_a_window_inflates_only_the_packets_that_it_touches(tmp_path, ev, first, start, length):
    ev = Events(ev.t - ev.start + first, ev.x, ev.y, ev.p, SIZE)
    parts = [ev[i : i + 50] for i in range(0, len(ev), 50)]
    recording = written(tmp_path / "a.aedat4", parts)
    seen, chosen = [], recording._chosen
    recording._chosen = lambda packets: chosen(seen.append(packets) or packets)
    window = recording.read(first + start, first + start + length)
    assert window == ev.window(first + start, first + start + length)
    assert recording._whole is None
    (packets,) = seen
    touched = [p for p in parts if p.t[-1] >= first + start and p.t[0] < first + start + length]
    # and the neighbors
    assert packets.at.size <= len(touched) + 2
    assert recording.span == (int(ev.t[0]), int(ev.t[-1]))
    assert recording._whole is None
    assert recording.read() == ev


def zeros(rows):
    return [[*row[:3], 0, 0, 0] for row in rows]


def wrong_times(rows):
    return [[*row[:4], row[4] - 5, row[5] - 5] for row in rows]


def later(rows):
    return [[*row[:4], row[4] + 5, row[5] + 5] for row in rows]


def wrong_number(rows):
    return [[*row[:3], row[3] - 1, *row[4:]] for row in rows]


def without_the_last(rows):
    return rows[:-1]


def none(rows):
    return []


def backwards(rows):
    return [[*row[:4], row[5], row[4]] for row in rows]


def beyond(rows):
    return [[row[0] + 2**40, *row[1:]] for row in rows]


def nested(rows):
    # the first seems to last longer than it does
    return [[*rows[0][:5], rows[1][5]], *rows[1:]]


def other_stream(rows):
    # the packet seems to be of something else
    return [rows[0], [rows[1][0], 4, *rows[1][2:]]]


def ends_early(rows):
    return [[*rows[0][:5], rows[0][4] + 5], rows[1]]


def starts_late(rows):
    return [rows[0], [*rows[1][:4], rows[1][5] - 5, rows[1][5]]]


HIDING = other_stream, ends_early, starts_late


@pytest.mark.parametrize(
    "change",
    [zeros, wrong_times, later, wrong_number, without_the_last, none, backwards, beyond, nested, *HIDING],
)
def test_a_table_that_is_wrong_is_not_used(tmp_path, change):
    a, b, both = two_parts()
    path = tmp_path / "a.aedat4"
    assert written(path, (a, b), change).read(1_050, 2_050) == both.window(1_050, 2_050)
    assert written(path, (a, b), change).span == (1_000, 2_099)
    for start in (1_000, 1_050, 1_090, 2_000, 2_010, 2_090):
        assert written(path, (a, b), change).read(start, start + 10) == both.window(start, start + 10)
    assert written(path, (a, b), change).read() == both


def test_packets_out_of_order_are_sorted(tmp_path):
    a, b, both = two_parts()
    recording = written(tmp_path / "a.aedat4", (b, a))
    assert recording.read(1_050, 2_050) == both.window(1_050, 2_050)
    assert recording.span == (1_000, 2_099)
    mixed = Events.trusted(both.columns.take(np.r_[100:200, 0:100]), SIZE)
    recording = written(tmp_path / "b.aedat4", (mixed,))
    assert recording.read(1_050, 2_050) == both.window(1_050, 2_050)
    assert recording.span == (1_000, 2_099)


def test_a_broken_table_costs_nothing_but_time(tmp_path):
    a, b, both = two_parts()
    path = tmp_path / "a.aedat4"
    written(path, (a, b))
    raw = path.read_bytes()
    for cut in (1, 50, 100):
        path.write_bytes(raw[:-cut])
        assert nvsdata.read(path, 1_050, 2_050, sensor_size=SIZE) == both.window(1_050, 2_050)
    rng = np.random.default_rng(0)
    begin = nvsdata.open(path)._end
    for _ in range(100):
        flipped = bytearray(raw)
        for place in rng.integers(begin, len(raw), 3):
            flipped[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(flipped)
        assert nvsdata.read(path, sensor_size=SIZE) == both


def test_an_event_outside_is_counted_from_the_beginning_of_the_file(tmp_path):
    parts = [Events(range(t, t + 50), [wide] * 49 + [2 * wide], [0] * 50, [1] * 50, SIZE) for t, wide in PARTS]
    recording = written(tmp_path / "a.aedat4", parts)
    recording._size = (60, 240)
    with pytest.raises(FormatError, match="event 149: outside the sensor"):
        recording.read(3_000, 3_100)


PARTS = ((1_000, 10), (2_000, 20), (3_000, 30))


def test_damage_in_a_window_is_named_and_elsewhere_not_looked_at(tmp_path):
    a, b, _ = two_parts()
    path = tmp_path / "a.aedat4"
    between = Events([1_500], [1], [1], [1], SIZE)
    place = int(written(path, (a, between, b))._table("EVTS").at[2])
    raw = bytearray(path.read_bytes())
    raw[place + 8 : place + 12] = b"WHAT"
    path.write_bytes(raw)
    assert nvsdata.read(path, 1_000, 1_050, sensor_size=SIZE) == a.window(1_000, 1_050)
    with pytest.raises(FormatError, match=f"byte {place - 8}: damaged AEDAT 4: no EVTS but b'WHAT'"):
        nvsdata.read(path, 2_000, 2_050, sensor_size=SIZE)
    assert nvsdata.read(path, 1_000, 2_050, sensor_size=SIZE, strict=False).t.tolist() == [*range(1_000, 1_100), 1_500]


@given(
    ev=events(max_size=300, width=2_000, height=1_000),
    first=st.integers(-(2**61), 2**61),
    cuts=st.lists(st.integers(0, 300), max_size=2),
)
def test_what_is_written_is_read_back(tmp_path, ev, first, cuts):
    pytest.importorskip("lz4")
    ev = Events(ev.t - ev.start + first, ev.x, ev.y, ev.p, (2_000, 1_000))
    edges = [0, *sorted(cuts), 300]
    pieces = [ev[a:b] for a, b in zip(edges, edges[1:], strict=False)]  # noqa: RUF007
    assert nvsdata.write(iter(pieces), tmp_path / "a.aedat4") == len(ev)
    recording = nvsdata.open(tmp_path / "a.aedat4")
    assert (recording.format, recording.sensor_size) == ("aedat4", (2_000, 1_000))
    assert recording.read() == ev
    if len(ev):
        assert recording._table("EVTS").elements.sum() == len(ev)
        assert (recording.start, recording.end, recording.span) == (ev.start, ev.end, (ev.t[0], ev.t[-1]))


def test_large_recordings_are_divided_into_packets(tmp_path):
    pytest.importorskip("lz4")
    t = np.arange(20_000) * 7
    ev = Events(t, t % 300, t % 200, t % 2, SIZE)
    nvsdata.write(ev, tmp_path / "a.aedat4")
    recording = nvsdata.open(tmp_path / "a.aedat4")
    assert recording._table("EVTS").elements.tolist() == [8192, 8192, 20_000 - 2 * 8192]
    assert recording.read(50_000, 90_000) == ev.window(50_000, 90_000)
    assert recording._whole is None


@pytest.mark.parametrize("program", ["aedat", "faery"])
def test_other_programs_read_what_is_written(tmp_path, program):
    module = pytest.importorskip(program)
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(1_600_000_000_000_000, 1_600_000_001_000_000, 20_000))
    ev = Events(t, rng.integers(0, 320, t.size), rng.integers(0, 240, t.size), rng.integers(0, 2, t.size), SIZE)
    nvsdata.write(ev, tmp_path / "a.aedat4")
    if program == "aedat":
        decoder = module.Decoder(str(tmp_path / "a.aedat4"))
        (stream,) = decoder.id_to_stream().values()
        assert (stream["type"], stream["width"], stream["height"]) == ("events", 320, 240)
        found = np.concatenate([packet["events"] for packet in decoder])
    else:
        found = np.concatenate(list(module.events_stream_from_file(tmp_path / "a.aedat4")))
    for ours, name in zip(ev.columns, found.dtype.names, strict=True):
        assert np.array_equal(ours, found[name])


def test_without_its_packages_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "lz4", None)
    monkeypatch.setitem(sys.modules, "lz4.frame", None)
    with pytest.raises(
        ImportError, match=r"^AEDAT 4 needs the packages lz4 and zstandard: pip install 'nvsdata\[aedat4"
    ):
        nvsdata.write(Events([1], [2], [3], [1], SIZE), tmp_path / "a.aedat4")
    assert not list(tmp_path.iterdir())


def test_a_flipped_bit_in_the_table_is_seen(tmp_path):
    pytest.importorskip("lz4")
    t = np.arange(30_000) * 7
    ev = Events(t, t % 300, t % 200, t % 2, SIZE)
    path = tmp_path / "a.aedat4"
    nvsdata.write(ev, path)
    raw, begin = path.read_bytes(), nvsdata.open(path)._end
    for bit in range(0, 8 * (len(raw) - begin), 5):
        changed = bytearray(raw)
        changed[begin + bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        for start in (0, 70_000, 200_000):
            assert nvsdata.read(path, start, start + 3_000) == ev.window(start, start + 3_000)
        assert nvsdata.open(path).span == (0, t[-1])


def test_files_of_ours_name_no_camera(tmp_path):
    pytest.importorskip("lz4")
    nvsdata.write(two_parts()[0], tmp_path / "a.aedat4")
    assert nvsdata.open(tmp_path / "a.aedat4").about == {}


def test_a_packet_that_inflates_without_end_is_refused():
    lz4 = pytest.importorskip("lz4.frame")
    inflate = aedat4_packets.inflater("a.aedat4", 1)
    assert inflate(lz4.compress(b"x" * 1_000), 1_000) == b"x" * 1_000
    with pytest.raises(OverflowError, match="expands to more than 1000 bytes"):
        inflate(lz4.compress(b"x" * 1_001), 1_000)
    with pytest.raises(ValueError, match="is truncated"):
        inflate(lz4.compress(b"abcdefgh" * 10)[:-10], 1_000)


def test_rows_that_are_written_have_no_gaps():
    """Memory that isn't set would get into files, and two runs would differ."""
    from nvsdata.formats.aedat.aedat4_writer import ROW

    assert sum(ROW[name].itemsize for name in ROW.names) == ROW.itemsize


@pytest.mark.parametrize("size", [0, 1, 100, 1_000, 100_000])
def test_packets_that_are_compressed_more_than_usual(size):
    packet = aedat4_packets.deflater()(bytes(size))
    inflate = aedat4_packets.inflater("a.aedat4", 1)
    assert inflate(memoryview(packet), size + 1) == bytes(size)
    with pytest.raises(ValueError, match="truncated"):
        inflate(memoryview(packet[:-1]), size + 1)
