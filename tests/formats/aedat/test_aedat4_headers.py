"""Headers, streams and packets of AEDAT 4 that are torn, left out or name other things."""

import struct

import numpy as np
import pytest
from flatbuffers import aedat4_file, frame, inertial, triggers
from lookalikes import aedat4_bytes, aedat4_events

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats.aedat import aedat4_packets
from nvsdata.formats.aedat.aedat4_packets import Packets

EV = Events([1_000, 2_000, 3_000], [1, 2, 3], [3, 4, 5], [1, 0, 1], (320, 240))


def opened(tmp_path, raw, **options):
    (tmp_path / "a.aedat4").write_bytes(raw)
    return nvsdata.open(tmp_path / "a.aedat4", **options)


def test_a_header_beyond_the_file_is_named(tmp_path):
    raw = aedat4_bytes(Events.empty((320, 240)))
    length = len(raw) - 18
    assert len(opened(tmp_path, raw).read()) == 0
    with pytest.raises(FormatError) as caught:
        opened(tmp_path, raw[:-1])
    assert (caught.value.reason, caught.value.offset) == (f"truncated: a header of {length} bytes", 14)
    for end in (14, 17):
        with pytest.raises(FormatError, match="byte 14: damaged AEDAT 4: "):
            opened(tmp_path, raw[:end])


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (b"IOHE", b"WHAT", "no IOHE but b'WHAT'"),
        (b"</dv>", b"<dv/>", "no element|mismatched|unclosed"),
        (b">EVTS<", b">ELSE<", "no stream of events"),
        (
            b'"1"><attr key="typeIdentifier" type="string">EVTS',
            b'"x"><attr key="typeIdentifier" type="string">EVTS',
            "invalid",
        ),
        (struct.pack("<iiq", 12, 0, -1), struct.pack("<iiq", 12, 5, -1), "unknown compression 5"),
    ],
)
def test_damaged_headers_are_named(tmp_path, old, new, reason):
    raw = aedat4_bytes(EV)
    assert raw.count(old) == 1
    with pytest.raises(FormatError, match=f"byte 14: damaged AEDAT 4: .*({reason})"):
        opened(tmp_path, raw.replace(old, new))


@pytest.mark.parametrize("compression", [0, 1, 2, 3, 4])
def test_each_compression(tmp_path, compression):
    pytest.importorskip("lz4")
    pytest.importorskip("zstandard")
    assert opened(tmp_path, aedat4_bytes(EV, compression)).read() == EV


def test_of_several_streams_the_first_is_read(tmp_path):
    raw = aedat4_bytes(EV)
    more = raw.replace(
        b'<node name="0"><attr key="typeIdentifier" type="string">IMUS',
        b'<node name="0"><attr key="typeIdentifier" type="string">EVTS',
    )
    with pytest.raises(FormatError, match="damaged AEDAT 4"):
        opened(tmp_path, more).read()
    swapped = raw.replace(b'name="0"', b'name="7"')
    assert opened(tmp_path, swapped).read() == EV


@pytest.mark.parametrize("cut", [1, 7, 8, 9, 30])
def test_torn_packets_are_named_and_what_is_before_them_kept(tmp_path, cut):
    """Packets of 50 events each, after one of something else each."""
    t = np.arange(150)
    ev = Events(t, t, t, t % 2, (320, 240))
    whole = aedat4_bytes(ev)
    size = 8 + len(aedat4_events(ev[:50]))
    raw = whole[: len(whole) - size + cut]
    begin = len(whole) - size
    left = f"{cut} bytes are left over" if cut < 8 else f"a packet of {size - 8} bytes, {cut - 8} are left"
    with pytest.raises(FormatError) as caught:
        opened(tmp_path, raw).read()
    assert (caught.value.reason, caught.value.offset) == (f"truncated: {left}", begin)
    repaired = opened(tmp_path, raw, strict=False)
    assert repaired.read() == ev[:100]
    assert repaired.repairs == {"packets from the first damaged one on, cut off": 1}
    negative = whole[:begin] + struct.pack("<ii", 1, -1) + whole[begin + 8 :]
    with pytest.raises(FormatError, match=f"truncated: a packet of -1 bytes, {size - 8} are left"):
        opened(tmp_path, negative).read()


def test_a_damaged_packet_in_the_middle_costs_no_other(tmp_path):
    t = np.arange(150)
    ev = Events(t, t, t, t % 2, (320, 240))
    whole = aedat4_bytes(ev)
    middle = whole.index(b"EVTS", whole.index(b"EVTS", whole.index(b"</dv>")) + 1)
    raw = whole[:middle] + b"OOPS" + whole[middle + 4 :]
    with pytest.raises(FormatError, match="damaged AEDAT 4: no EVTS"):
        opened(tmp_path, raw).read()
    repaired = opened(tmp_path, raw, strict=False)
    assert repaired.read() == Events(*(np.delete(c, slice(50, 100)) for c in ev.columns), (320, 240))
    assert repaired.repairs == {"damaged packets, left out": 1}


def test_more_events_than_a_packet_has_room_for_are_damage(tmp_path):
    content = aedat4_events(EV)
    assert content.count(struct.pack("<II", 4, 3)) == 1
    more = content.replace(struct.pack("<II", 4, 3), struct.pack("<II", 4, 4))
    with pytest.raises(FormatError, match="damaged AEDAT 4: 4 events in "):
        opened(tmp_path, aedat4_file([("EVTS", more)]), sensor_size=(320, 240)).read()
    fewer = content.replace(struct.pack("<II", 4, 3), struct.pack("<II", 4, 2))
    assert opened(tmp_path, aedat4_file([("EVTS", fewer)]), sensor_size=(320, 240)).read() == EV[:2]


def test_what_a_file_says_about_its_camera(tmp_path):
    raw = aedat4_bytes(EV)
    assert opened(tmp_path, raw).about == {}
    head, rest = raw[14:18], raw[18:]
    named = rest.replace(b'<attr key="sizeY"', b'<attr key="source" type="string">DAVIS</attr><attr key="sizeY"')
    grown = len(named) - len(rest)
    text = struct.unpack_from("<I", rest, 40)[0]
    assert named[40:44] == rest[40:44] == struct.pack("<I", text)
    named = named[:40] + struct.pack("<I", text + grown) + named[44:]
    found = opened(tmp_path, raw[:14] + struct.pack("<I", struct.unpack("<I", head)[0] + grown) + named)
    assert found.about == {"camera": "DAVIS"}
    assert found.read() == EV


def rows(path, at, kind, packets):
    """A file whose table tells times of its own: (first, last) for each packet."""
    contents = [content for content, _ in packets]

    def table(begin):
        found = []
        for n, (content, times) in enumerate(packets):
            place = begin + sum(8 + len(one) for one in contents[:n])
            found.append((place + 8, at if n else 0, len(content), 1, *times))
        return found

    names = ["EVTS", *[kind] * (len(packets) - 1)]
    path.write_bytes(aedat4_file(list(zip(names, contents, strict=True)), table=table))
    return nvsdata.open(path, sensor_size=(320, 240))


@pytest.mark.parametrize(("at", "kind"), [(2, "IMUS"), (3, "TRIG")])
def test_windows_of_samples_read_packets_up_to_a_second_away(tmp_path, at, kind):
    second = 1_000_000
    events = aedat4_events(EV[:1])
    make = (lambda t: inertial([(t, *[0.0] * 7)])) if kind == "IMUS" else (lambda t: triggers([(t, 1)]))
    times = (0, 3 * second, 6 * second)
    packets = [(events, (1_000, 1_000)), *((make(t), (t, t)) for t in times)]
    found = rows(tmp_path / "a.aedat4", at, kind, packets)
    read = []
    chosen = found._chosen
    found._chosen = lambda some: chosen(read.append(some.start.tolist()) or some)
    ask = found.inertial if kind == "IMUS" else found.triggers
    for start, stop, expected, inside in (
        (None, None, [*times], [*times]),
        (4 * second, None, [3 * second, 6 * second], [6 * second]),
        (4 * second + 1, None, [6 * second], [6 * second]),
        (None, 2 * second, [0], [0]),
        (None, 2 * second + 1, [0, 3 * second], [0]),
        (3 * second, 3 * second + 1, [3 * second], [3 * second]),
    ):
        read.clear()
        assert ask(start, stop).t.tolist() == inside
        assert read == [expected]


def test_a_table_tells_whether_packets_are_in_order():
    def packets(*times):
        start, end = np.array(times).T
        return Packets(*[np.zeros(len(times), int)] * 4, start, end)

    assert packets((1, 1), (1, 5), (5, 5), (9, 12)).ordered
    assert not packets((1, 4), (3, 5)).ordered
    assert not packets((1, 4), (5, 4)).ordered
    assert not packets((2, 1), (5, 6)).ordered


@pytest.mark.parametrize("kind", [0, 2, 16])
def test_a_frame_up_to_its_last_byte(tmp_path, kind):
    size = 6 * {0: 1, 2: 2, 16: 3}[kind]
    for more in (-1, 0, 1):
        content = frame([5] * 5, kind, 3, 2, (0, 0), bytes(size + more))
        found = opened(tmp_path, aedat4_file([("EVTS", aedat4_events(EV)), ("FRME", content)]), sensor_size=(320, 240))
        if more:
            with pytest.raises(FormatError, match=f"a frame of 3x2 pixels of type {kind} in {size + more} bytes"):
                list(found.frames())
        else:
            assert [one.pixels.shape for one in found.frames()] == [(2, 3)]


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ([9, None, None, None, None], (9, 9, 9, 9)),
        ([9, 1, 8, 2, 5], (1, 2, 5, 8)),
        ([9, None, 8, 2, 5], (2, 2, 5, 8)),
        ([9, 1, None, 2, 5], (1, 2, 5, 5)),
        ([9, 1, 8, 2, None], (1, 2, 2, 8)),
        ([9, 1, None, None, 30], (1, 9, 30, 30)),
    ],
)
def test_times_of_a_frame_that_lacks_some(tmp_path, times, expected):
    content = frame(times, 0, 3, 2, (0, 0), bytes(6))
    found = opened(tmp_path, aedat4_file([("EVTS", aedat4_events(EV)), ("FRME", content)]), sensor_size=(320, 240))
    (one,) = found.frames()
    assert (one.start, one.exposure_start, one.exposure_end, one.end) == expected


def test_packets_of_zstandard_up_to_the_bound():
    zstandard = pytest.importorskip("zstandard")
    for compression in (3, 4):
        inflate = aedat4_packets.inflater("a.aedat4", compression)
        compress = zstandard.ZstdCompressor().compress
        assert inflate(compress(b"x" * 1_000), 1_000) == b"x" * 1_000
        with pytest.raises(OverflowError, match="a packet expands to 1001 bytes"):
            inflate(compress(b"x" * 1_001), 1_000)
        # of unknown size
        stream = zstandard.ZstdCompressor(write_content_size=False).compress(b"x" * 1_000)
        assert inflate(stream, 1_000) == b"x" * 1_000
        with pytest.raises(OverflowError, match="a packet expands to more than 999 bytes"):
            inflate(stream, 999)
        with pytest.raises(zstandard.ZstdError):
            inflate(stream[:-3], 1_000)
