"""Events of ROS bags, compared with what rosbags itself reads, event by event."""

import struct
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbag_files import EPOCH, EVENTS, PACKETS, WAYS, Raw, types_of, write_bag
from strategies import events

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.kernels.decode.evt3 import evt3_encode

pytest.importorskip("rosbags")
COMPRESSIONS = [("bag", "bz2"), ("bag", "lz4"), ("mcap", "storage"), ("mcap", "message"), ("db3", "message")]
every_way = pytest.mark.parametrize("way", WAYS)


def parts_of(ev, cuts):
    """The events in parts, some of them empty."""
    edges = [0, *sorted(cut % (len(ev) + 1) for cut in cuts), len(ev)]
    return [ev[a:b] for a, b in pairwise(edges)]


def arrays(types, ev, cuts, frame, name=EVENTS[0]):
    """Messages of the parts of events; the bag's times are others than the events'."""
    parts = parts_of(ev, cuts)
    return [
        ("/dvs/events", k * 1_000 + 5, types.events(*part.columns, ev.sensor_size, name, frame=frame))
        for k, part in enumerate(parts)
    ]


def as_rosbags_reads(types, messages):
    """The events of messages, one by one."""
    t, x, y, p = [], [], [], []
    for _, _, message in messages:
        for one in types.read(types.raw(message), message.__msgtype__).events:
            t.append(one.ts.sec * 1_000_000 + one.ts.nanosec // 1000)
            x.append(one.x)
            y.append(one.y)
            p.append(one.polarity)
    return Events(t, x, y, p, (messages[0][2].width, messages[0][2].height))


@every_way
@settings(max_examples=15)
@given(
    ev=events(max_size=60, first=EPOCH, gap=30_000_000),
    cuts=st.lists(st.integers(0, 60), max_size=6),
    frame=st.text("ab/", max_size=9),
    name=st.sampled_from(EVENTS),
)
def test_events_are_those_that_rosbags_reads(tmp_path_factory, way, ev, cuts, frame, name):
    types = types_of(way)
    messages = arrays(types, ev, cuts, frame, name)
    found = nvsdata.open(write_bag(tmp_path_factory.mktemp("a"), types, messages)).read()
    assert found == ev
    assert found == as_rosbags_reads(types, messages)


@every_way
@settings(max_examples=15)
@given(
    ev=events(max_size=300, first=EPOCH, gap=30_000),
    cuts=st.lists(st.integers(0, 300), max_size=30),
    start=st.integers(-100, 3_000_000),
    length=st.integers(0, 3_000_000),
)
def test_window_equals_slice_of_whole(tmp_path_factory, way, ev, cuts, start, length):
    types = types_of(way)
    path = write_bag(tmp_path_factory.mktemp("a"), types, arrays(types, ev, cuts, "cam"))
    recording, start = nvsdata.open(path), start + EPOCH
    assert recording.read(start, start + length) == ev.window(start, start + length)
    assert recording.read(start) == ev.window(start)
    assert recording.read(None, start) == ev.window(None, start)
    assert recording.span == ((ev.t[0], ev.t[-1]) if len(ev) else (0, 0))


@pytest.mark.parametrize(("way", "compression"), COMPRESSIONS)
def test_compressed_bags(tmp_path, way, compression):
    types, ev = types_of(way), some_events()
    path = write_bag(tmp_path, types, arrays(types, ev, range(0, 2000, 90), "cam"), compression=compression)
    assert nvsdata.open(path).read() == ev
    assert nvsdata.open(path).read(EPOCH + 700, EPOCH + 900) == ev.window(EPOCH + 700, EPOCH + 900)


def some_events(n=2_000, first=EPOCH, size=(640, 480)):
    rng = np.random.default_rng(3)
    xy = rng.integers(0, size[0], n), rng.integers(0, size[1], n)
    return Events(first + np.sort(rng.integers(0, 1_000_000, n)), *xy, rng.integers(0, 2, n), size)


def test_a_window_reads_few_messages(tmp_path, monkeypatch):
    types, ev = types_of("mcap"), some_events(first=EPOCH)
    far = Events(EPOCH + 10_000_000 * np.arange(2_000), ev.x, ev.y, ev.p, ev.sensor_size)
    recording = nvsdata.open(write_bag(tmp_path, types, arrays(types, far, range(2_000), "cam")))
    read = []
    whole = recording._bag.read
    monkeypatch.setattr(recording._bag, "read", lambda rows: read.append(len(rows)) or whole(rows))
    assert len(recording.read(int(far.t[1_000]), int(far.t[1_003]))) == 3
    assert sum(read) < 50


@every_way
@settings(max_examples=15)
@given(
    ev=events(max_size=300, width=2_000, height=2_000, gap=2_000_000),
    cuts=st.lists(st.integers(0, 2_000), max_size=9),
    start=st.integers(0, 300_000_000),
)
def test_evt3_packets_equal_the_raw_file(tmp_path_factory, way, ev, cuts, start):
    types, folder = types_of(way), tmp_path_factory.mktemp("a")
    words = evt3_encode(*ev.columns, np.full(3, -1, np.int64))
    edges = [0, *sorted(cut % (words.size + 1) for cut in cuts), words.size]
    packets = [words[a:b].tobytes() for a, b in pairwise(edges)]
    messages = [("/ev", k, types.packet(data, ev.sensor_size, "evt3", base=7)) for k, data in enumerate(packets)]
    recording = nvsdata.open(write_bag(folder, types, messages))
    assert recording.read() == ev
    recording = nvsdata.open(recording.path)
    assert recording.read(start, start + 1_000_000) == ev.window(start, start + 1_000_000)


def mono(ev, base):
    """Words of the encoding "mono" at ns after `base`, one by one."""
    rows = zip(*(column.tolist() for column in ev.columns), strict=True)
    words = [(t * 1000 + 999 - base) | x << 32 | y << 48 | p << 63 for t, x, y, p in rows]
    return np.array(words, "<u8").tobytes()


@every_way
@settings(max_examples=15)
@given(
    ev=events(max_size=100, gap=20_000),
    cuts=st.lists(st.integers(0, 100), max_size=5),
    start=st.integers(0, 10**6),
    name=st.sampled_from(PACKETS),
)
def test_mono_packets(tmp_path_factory, way, ev, cuts, start, name):
    types, messages = types_of(way), []
    for k, part in enumerate(parts_of(ev, cuts)):
        base = int(part.t[0]) * 1000 if len(part) else 0
        messages.append(("/ev", k, types.packet(mono(part, base), ev.sensor_size, "mono", base=base, name=name)))
    recording = nvsdata.open(write_bag(tmp_path_factory.mktemp("a"), types, messages))
    assert recording.read(start, start + 99_999) == ev.window(start, start + 99_999)
    assert recording.read() == ev


@pytest.mark.parametrize(
    ("way", "seconds"), [("bag", 2**32 - 1), ("bag", 2**31), ("mcap", 2**31 - 1), ("db3", -1), ("mcap", -(2**31))]
)
def test_times_are_exact_up_to_the_limits(tmp_path, way, seconds):
    """Seconds are uint32 in ROS 1, and int32 in ROS 2."""
    types = types_of(way)
    raw = types.raw(types.events([1_234_567_890_999_999], [1], [2], [1], (4, 4), stamp=5))
    stated = struct.pack("<I", 1_234_567_890)
    assert raw.count(stated) == 1
    message = Raw(EVENTS[0], raw.replace(stated, struct.pack("<i" if way != "bag" else "<I", seconds)))
    found = nvsdata.open(write_bag(tmp_path, types, [("/e", 1, message)])).read()
    assert found.t.tolist() == [seconds * 1_000_000 + 999_999]


def test_messages_out_of_order(tmp_path):
    """Times that fall a little are sorted; the clock was set back if they fall more."""
    types, ev = types_of("bag"), some_events()
    messages = arrays(types, ev, [300, 600, 900, 1_500], "cam")
    for fall, fails in ((90_000, False), (110_000, True)):
        back = Events(ev.t[-1:] - fall, [1], [1], [1], ev.sensor_size)
        added = [*messages, ("/dvs/events", 9_000, types.events(*back.columns, ev.sensor_size))]
        path = write_bag(tmp_path, types, added, name=str(fall))
        every = Events(*(np.concatenate(both) for both in zip(ev.columns, back.columns, strict=True)), ev.sensor_size)
        if fails:
            with pytest.raises(FormatError, match=r"/dvs/events: the time falls by \d+ µs"):
                nvsdata.read(path)
        else:
            recording, (a, b) = nvsdata.open(path), (int(back.t[0]) - 10, int(back.t[0]) + 10)
            assert recording.read(a, b) == every.window(a, b)
            assert recording.read() == every
        repaired = nvsdata.open(path, strict=False)
        assert repaired.read() == every
        assert repaired.repairs == {"steps back in time, sorted": 1}


def test_a_size_of_0_is_unknown(tmp_path):
    types = types_of("bag")
    path = write_bag(tmp_path, types, [("/e", 1, types.events([EPOCH], [5], [2], [1], (0, 0)))])
    assert nvsdata.open(path).sensor_size == (6, 3)
    assert nvsdata.open(path, sensor_size=(9, 9)).read().sensor_size == (9, 9)
