"""Serialized ROS messages: a cursor over their fields, and the messages of event cameras and inertial units.

ROS 1 messages have no padding. ROS 2 messages (CDR) begin with four bytes that name the byte order, and each number is
aligned to its size, counted from the fifth byte. Events are never turned into objects: a message of events is a view of
its bytes. Damaged messages raise struct.error or ValueError, and unsupported encodings NotImplementedError.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from nvsdata.data.events import LATEST
from nvsdata.data.samples import Inertial

G, DEGREES = 9.80665, 180 / np.pi
NANO = 1_000_000_000
EVENTS = "dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray"
# the second name is an earlier one
PACKETS = "event_camera_msgs/msg/EventPacket", "event_array_msgs/msg/EventArray"
IMU = "sensor_msgs/msg/Imu"
_EVENT = "std_msgs/Header header\nuint32 height\nuint32 width\n{0}/Event[] events\n" + "=" * 80
_EVENT += "\nMSG: {0}/Event\nuint16 x\nuint16 y\ntime ts\nbool polarity\n"
_PACKET = "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
_PACKET += "bool is_bigendian\nuint8[] events\n"
# the definitions that this module reads; a bag that states another one is refused
DEFINITIONS = {name: _EVENT.format(name.split("/")[0]) for name in EVENTS} | dict.fromkeys(PACKETS, _PACKET)
# events in the bytes of `PackedEvents.data`: 13 bytes in ROS 1. In CDR, x and y follow the event before them directly,
# but the time is aligned to 4 bytes. Two bytes after the first y, and one at the end, make all events alike
EVENT_1 = np.dtype([("x", "<u2"), ("y", "<u2"), ("s", "<u4"), ("ns", "<u4"), ("on", "u1")])
EVENT_2 = np.dtype(
    {
        "names": ["x", "y", "s", "ns", "on"],
        "formats": ["<u2", "<u2", "<i4", "<u4", "u1"],
        "offsets": [0, 2, 6, 10, 14],
        "itemsize": 16,
    }
)
ZSTD = b"(\xb5/\xfd"  # first bytes of compressed data
PADDING = 2, 1  # bytes after the first y, and after the last event
NUMBERS = {kind: struct.Struct(f"<{kind}") for kind in "BiIQ"}
WORD = np.dtype("<u8")  # an event of the encoding "mono", or a trigger


class PackedEvents(NamedTuple):
    """The events or triggers of a message, still encoded.

    Args:
        stamp: Time in the message's header, ns.
        size: (width, height) in pixels; (0, 0) if unknown.
        encoding: "events" for records with absolute times, otherwise the encoding that the message names.
        base: Time in ns that is added to the times of the data.
        data: The bytes in parts, which are joined before decoding.
    """

    stamp: int
    size: tuple[int, int]
    encoding: str
    base: int
    data: tuple[memoryview | bytes, ...]


class Cursor:
    """A position in a serialized message, from which fields are read one after the other.

    Args:
        raw: The message.
        cdr: Whether it is of ROS 2 (CDR) rather than of ROS 1.
    """

    def __init__(self, raw: bytes | memoryview, cdr: bool) -> None:
        self.raw, self.cdr = memoryview(raw), cdr
        if cdr:
            head = bytes(self.raw[:4])
            if head == ZSTD:
                raise ValueError("compressed: open the bag's folder, whose metadata.yaml states how")
            if head[:2] != b"\0\1":
                raise ValueError(f"begins with {head.hex()}, not like little-endian CDR")
            self.raw = self.raw[4:]
        self.at = 0

    def number(self, kind: str) -> int:
        """Return the next number; `kind` is a letter of the module struct."""
        number = NUMBERS[kind]
        self.align(number.size)
        value: int = number.unpack_from(self.raw, self.at)[0]
        self.at += number.size
        return value

    def align(self, size: int) -> None:
        """Skip the padding before a field of `size` bytes."""
        if self.cdr:
            self.at += -self.at % size

    def bytes(self, count: int) -> memoryview:
        """Return the next `count` bytes. ValueError if there are fewer."""
        left = len(self.raw) - self.at
        if count > left:
            raise ValueError(f"states {count} bytes of data, {max(left, 0)} are there")
        self.at += count
        return self.raw[self.at - count : self.at]

    def text(self) -> str:
        """Return the next string."""
        return bytes(self.bytes(self.number("I"))).rstrip(b"\0").decode("utf-8", "replace")

    def header(self) -> int:
        """Read a std_msgs/Header, and return its time in ns."""
        if not self.cdr:
            self.number("I")
        stamp = self.number("i" if self.cdr else "I") * NANO + self.number("I")
        self.text()
        return stamp


def unpack_events(raw: bytes | memoryview, cdr: bool) -> PackedEvents:
    """Return the events of a dvs_msgs or prophesee_event_msgs EventArray."""
    cursor = Cursor(raw, cdr)
    stamp, height, width, count = cursor.header(), cursor.number("I"), cursor.number("I"), cursor.number("I")
    if not cdr:
        return PackedEvents(stamp, (width, height), "events", 0, (cursor.bytes(count * EVENT_1.itemsize),))
    if not count:
        return PackedEvents(stamp, (width, height), "events", 0, ())
    data = cursor.bytes(count * EVENT_2.itemsize - sum(PADDING))
    parts = data[:4], bytes(PADDING[0]), data[4:], bytes(PADDING[1])
    return PackedEvents(stamp, (width, height), "events", 0, parts)


def unpack_packet(raw: bytes | memoryview, cdr: bool) -> PackedEvents:
    """Return the data of an event_camera_msgs EventPacket."""
    cursor = Cursor(raw, cdr)
    stamp, height, width = cursor.header(), cursor.number("I"), cursor.number("I")
    cursor.number("Q")
    base, encoding, reverse = cursor.number("Q"), cursor.text(), cursor.number("B")
    data = cursor.bytes(cursor.number("I"))
    size = {"evt3": 2, "mono": 8, "trigger": 8}.get(encoding)
    if size is None:
        raise NotImplementedError(f"encoding {encoding[:40]!r}; known are evt3, mono and trigger")
    if reverse:
        raise NotImplementedError("big-endian data")
    if len(data) % size:
        raise ValueError(f"{len(data)} bytes of {encoding}, not a multiple of {size}")
    if encoding != "evt3" and base >= LATEST:
        raise ValueError(f"a time base of {base} ns, beyond 2^62")
    return PackedEvents(stamp, (width, height), encoding, base if encoding != "evt3" else 0, (data,))


def unpack_imu(raw: bytes | memoryview, cdr: bool) -> Inertial:
    """Return the sample of a sensor_msgs/Imu, in the units of `Inertial`."""
    cursor = Cursor(raw, cdr)
    stamp = cursor.header()
    cursor.align(8)
    # orientation [4] and its covariance [9], rotation [3] and its covariance [9], acceleration [3]
    values = np.frombuffer(cursor.bytes(37 * 8), "<f8")
    with np.errstate(over="ignore"):
        rotation, acceleration = (values[13:16] * DEGREES).astype("f4"), (values[25:28] / G).astype("f4")
    return Inertial(np.array([stamp // 1000]), acceleration[None], rotation[None], np.zeros(1, np.float32))
