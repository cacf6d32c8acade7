"""Messages of ROS bags that are invalid, unusual or of another definition."""

import contextlib
import sqlite3
import struct

import numpy as np
import pytest
from rosbag_files import EPOCH, EVENTS, PACKETS, WAYS, Raw, Types, content, some, types_of, write_bag

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.formats.ros.images import unpack_image
from nvsdata.kernels.decode.evt3 import evt3_encode

pytest.importorskip("rosbags")
every_way = pytest.mark.parametrize("way", WAYS)


def test_events_outside_the_sensor_and_invalid_values(tmp_path):
    types = types_of("bag")
    for change, says in (
        ({"x": 64}, "outside the sensor of 64x48"),
        ({"x": 40_000}, "outside the sensor"),
        ({"y": 65_535}, "outside the sensor"),
    ):
        message = some(types, count=1)[0][2]
        for name, value in change.items():
            setattr(message.events[3], name, value)
        path = write_bag(tmp_path, types, [("/e", 1, message)], name=str(change.get("x")))
        with pytest.raises(FormatError, match=says):
            nvsdata.read(path)
        recording = nvsdata.open(path, strict=False)
        assert len(recording.read()) == 29
        assert recording.repairs == {"events outside the sensor, dropped": 1}


def test_nanoseconds_of_more_than_a_second(tmp_path):
    types = types_of("mcap")
    message = some(types, count=1)[0][2]
    message.events[3].ts.nanosec = 10**9
    path = write_bag(tmp_path, types, [("/e", 1, message)])
    with pytest.raises(FormatError, match="/e: damaged: a time of 1000000000 ns after a second"):
        nvsdata.read(path)
    recording = nvsdata.open(path, strict=False)
    assert len(recording.read()) == 29
    assert recording.repairs == {"events with invalid times, dropped": 1}


@pytest.mark.parametrize(
    ("encoding", "data", "more", "says"),
    [
        ("libcaer_cmp", b"", {}, "nvsdata doesn't read encoding 'libcaer_cmp'; known are evt3, mono and trigger"),
        ("evt3", b"abc", {}, "damaged: 3 bytes of evt3, not a multiple of 2"),
        ("mono", b"abcd", {}, "damaged: 4 bytes of mono, not a multiple of 8"),
        ("evt3", b"abcd", {"reverse": True}, "nvsdata doesn't read big-endian data"),
        ("mono", bytes(8), {"base": 2**63}, "damaged: a time base of 9223372036854775808 ns"),
    ],
)
def test_packets_that_are_not_read(tmp_path, encoding, data, more, says):
    types = types_of("mcap")
    path = write_bag(tmp_path, types, [("/e", 1, types.packet(data, (4, 4), encoding, **more))])
    with pytest.raises(FormatError, match=f"/e, message 0: {says}"):
        nvsdata.read(path)


def test_packets_of_two_encodings_on_one_topic(tmp_path):
    types = types_of("bag")
    both = [types.packet(bytes(8), (4, 4), encoding) for encoding in ("mono", "evt3")]
    for name, order in (("a", both), ("b", both[::-1])):
        path = write_bag(tmp_path, types, [("/e", k, packet) for k, packet in enumerate(order)], name=name)
        with pytest.raises(FormatError, match=r"/e: messages of \w+ and of \w+"):
            nvsdata.read(path)


@every_way
def test_a_bag_whose_definition_differs(tmp_path, way):
    from rosbags.typesys import get_types_from_msg

    types = Types(way)
    text = "std_msgs/Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n" + "=" * 80
    text += "\nMSG: dvs_msgs/Event\nuint32 x\nuint32 y\ntime ts\nbool polarity\n"
    for name in (EVENTS[0], EVENTS[0].replace("EventArray", "Event")):
        types.store.fielddefs.pop(name), types.store.types.pop(name)
    types.store.register(get_types_from_msg(text, EVENTS[0]))
    path = write_bag(tmp_path, types, [("/e", 1, types.events([5], [1], [2], [1], (4, 4)))])
    with pytest.raises(FormatError, match="/e: its definition of dvs_msgs/msg/Event isn't the public one"):
        nvsdata.open(path)


def test_a_database_without_definitions(tmp_path):
    types = types_of("db3")
    path = write_bag(tmp_path, types, some(types))
    with contextlib.closing(sqlite3.connect(content(path))) as database, database:
        database.execute("DELETE FROM message_definitions")
    assert len(nvsdata.read(path)) == 40 * 30


def test_frames_that_state_other_sizes():
    types = types_of("bag")
    for change, says in (
        ({"step": 3}, "rows of 3 bytes"),
        ({"height": 7}, "8x7 pixels"),
        ({"width": 0}, "0x6 pixels"),
        ({"encoding": "yuv422"}, "encoding 'yuv422'"),
    ):
        message = types.image(0, np.zeros((6, 8), np.uint8))
        for name, value in change.items():
            setattr(message, name, value)
        with pytest.raises((ValueError, NotImplementedError), match=says):
            unpack_image(types.raw(message), False)


def test_rows_with_padding():
    types = types_of("bag")
    pixels = np.arange(60, dtype=np.uint8).reshape(6, 10)
    message = types.image(0, pixels)
    message.width = 8
    np.testing.assert_array_equal(unpack_image(types.raw(message), False).pixels, pixels[:, :8])


def record(kind, data):
    return struct.pack("<BQ", kind, len(data)) + data


def text(value):
    return struct.pack("<I", len(value)) + value.encode()


def mcap_without_chunks(types, messages, kind=EVENTS[0], form="ros2msg", definition=""):
    """An MCAP file whose messages aren't in chunks, as `ros2 bag record --storage-preset-profile fastwrite` writes."""
    schema = record(3, struct.pack("<H", 1) + text(kind) + text(form) + text(definition))
    channel = record(4, struct.pack("<HH", 1, 1) + text("/e") + text("cdr") + text(""))
    body = b"\x89MCAP0\r\n" + record(1, text("ros2") + text("x")) + schema + channel
    for k, message in enumerate(messages):
        body += record(5, struct.pack("<HIQQ", 1, 0, k, k) + types.raw(message))
    body += record(15, bytes(4))
    count = struct.pack("<QHIIIIQQ", len(messages), 1, 1, 0, 0, 0, 0, len(messages))
    statistics = record(11, count + struct.pack("<IHQ", 10, 1, len(messages)))
    return body + schema + channel + statistics + record(2, struct.pack("<QQI", len(body), 0, 0)) + b"\x89MCAP0\r\n"


def test_mcap_without_chunks(tmp_path):
    types, path = types_of("mcap"), tmp_path / "a.mcap"
    messages = [message for topic, _, message in some(types) if topic == "/dvs/events"]
    data = mcap_without_chunks(types, messages)
    path.write_bytes(data)
    assert len(nvsdata.read(path)) == 40 * 30
    assert len(nvsdata.read(path, EPOCH + 5_000, EPOCH + 7_000)) == 60
    at = data.index(b"\5", data.index(b"\4"))
    for size in (2**63 - 1, 2**40, 3):
        path.write_bytes(data[: at + 1] + struct.pack("<Q", size) + data[at + 9 :])
        with pytest.raises(FormatError):
            nvsdata.read(path)


IDL = """\
module dvs_msgs {
  module msg {
    struct Event {
      uint16 x;
      uint16 y;
      builtin_interfaces::msg::Time ts;
      boolean polarity;
    };
  };
};
"""


def test_definitions_in_idl(tmp_path):
    types, path = types_of("mcap"), tmp_path / "a.mcap"
    line = "=" * 80
    for known, stated in ((True, IDL), (False, IDL.replace("uint16 x", "uint32 x")), (False, IDL[:-30])):
        definition = f"{line}\nIDL: dvs_msgs/msg/Event\n{stated}"
        path.write_bytes(mcap_without_chunks(types, [some(types, 1)[0][2]], form="ros2idl", definition=definition))
        if known:
            assert len(nvsdata.read(path)) == 30
        else:
            with pytest.raises(FormatError, match=r"/e: its definition|/e has a damaged definition"):
                nvsdata.read(path)


def test_damaged_packets_are_left_out_if_not_strict(tmp_path):
    types = types_of("bag")
    ev = Events([100, 200], [1, 2], [1, 2], [1, 0], (4, 4))
    data = evt3_encode(*ev.columns, np.full(3, -1, np.int64)).tobytes()
    good = types.packet(data, (4, 4), "evt3")
    bad = Raw(PACKETS[0], types.raw(good)[:-3])
    path = write_bag(tmp_path, types, [("/e", 1, good), ("/e", 2, bad)])
    with pytest.raises(FormatError, match="/e, message 1"):
        nvsdata.read(path)
    recording = nvsdata.open(path, strict=False)
    assert recording.read() == ev
    assert recording.repairs == {"damaged messages of events, left out": 1}
