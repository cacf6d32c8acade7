"""Events in the messages of a topic: records with times (dvs_msgs, prophesee_event_msgs, "mono"), and EVT3 words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import EVER, Columns, concatenate, sort_by_time
from nvsdata.data.samples import Triggers
from nvsdata.formats.contents import PIECE
from nvsdata.formats.evt.evt3 import Evt3Recording
from nvsdata.formats.file_recording import FileRecording
from nvsdata.formats.records import RecordFile
from nvsdata.formats.ros.containers import Bag, Topic
from nvsdata.formats.ros.messages import (
    EVENT_1,
    EVENT_2,
    NANO,
    PACKETS,
    WORD,
    PackedEvents,
    unpack_events,
    unpack_packet,
)
from nvsdata.formats.ros.topics import TopicMessages
from nvsdata.kernels.decode.clock import BACK_US
from nvsdata.kernels.decode.order import is_sorted


def records_of(packets: list[PackedEvents], cdr: bool) -> np.ndarray:
    """Return the records of messages of one encoding other than EVT3, as a structured or uint64 array [N]."""
    kind = WORD if packets[0].encoding != "events" else EVENT_2 if cdr else EVENT_1
    return np.frombuffer(b"".join(part for packet in packets for part in packet.data), kind)


def times_of(packets: list[PackedEvents], records: np.ndarray) -> np.ndarray:
    """Return the times of the records of messages in µs, int64 [N]."""
    if records.dtype.names:
        t: np.ndarray = records["s"].astype(np.int64)
        t *= 1_000_000
        t += records["ns"] // 1000
        return t
    counts = [sum(map(len, packet.data)) // WORD.itemsize for packet in packets]
    base = np.repeat(np.array([packet.base for packet in packets], np.int64), counts)
    times: np.ndarray = (base + (records & 0xFFFFFFFF).astype(np.int64)) // 1000
    return times


def columns_of(packets: list[PackedEvents], records: np.ndarray) -> Columns:
    """Return the events of messages of one encoding other than EVT3. A coordinate beyond 32767 becomes negative."""
    t = times_of(packets, records)
    if records.dtype.names:
        return Columns(t, records["x"].astype(np.int16), records["y"].astype(np.int16), records["on"].astype(np.uint8))
    x, y = (records >> 32).astype(np.uint16).view(np.int16), ((records >> 48) & 0x7FFF).astype(np.int16)
    return Columns(t, x, y, (records >> 63).astype(np.uint8))


def triggers_of(packet: PackedEvents) -> Triggers:
    """Return the triggers of a message of the encoding "trigger"."""
    words = records_of([packet], True)
    return Triggers(times_of([packet], words), ((words >> 48) & 0xFF).astype(np.uint8), (words >> 63).astype(np.uint8))


class RosEvents(FileRecording):
    """The events of a topic, in records with times."""

    format = "rosbag"

    def __init__(self, bag: Bag, topic: Topic, sensor_size: tuple[int, int] | None, strict: bool) -> None:
        super().__init__(bag.path, sensor_size, strict)
        unpack = unpack_packet if topic.kind in PACKETS else unpack_events
        self.stream = TopicMessages(bag, topic, unpack, self._bounds, strict)
        self._invalid = 0

    def _bounds(self, packet: PackedEvents) -> tuple[int, int] | None:
        t = times_of([packet], records_of([packet], self.stream.bag.cdr))
        return (int(t.min()), int(t.max())) if t.size else None

    def decode(self) -> Columns:
        return self._of_messages(None)

    def _of_messages(self, numbers: list[int] | None) -> Columns:
        """Decode the messages of these numbers; all if None."""
        self._invalid = 0
        parts = [self._columns(group) for group in groups(self._alike(self.stream.items(numbers)))]
        self._repair("events with invalid times, dropped", self._invalid)
        self._repair("damaged messages of events, left out", self.stream.damaged)
        columns = concatenate(parts) if parts else Columns.empty(0)
        self._check_order(columns.t)
        return columns

    def _columns(self, group: list[PackedEvents]) -> Columns:
        records = records_of(group, self.stream.bag.cdr)
        if records.dtype.names and (highest := records["ns"].max(initial=0)) >= NANO:
            if self.strict:
                reason = f"damaged: a time of {highest} ns after a second"
                raise FormatError(self.path, f"{self.stream.topic.name}: {reason}")
            valid = records["ns"] < NANO
            self._invalid += int(np.count_nonzero(~valid))
            records = records[valid]
        columns = columns_of(group, records)
        # otherwise all events are checked together
        return Columns(*self._inside(columns)) if self.strict else columns

    def _alike(self, packets: Iterable[PackedEvents]) -> Iterator[PackedEvents]:
        """Yield messages. FormatError for another encoding than that of the first one."""
        encoding = None
        for packet in packets:
            encoding = encoding or packet.encoding
            if packet.encoding != encoding:
                reason = f"messages of {encoding} and of {packet.encoding}"
                raise FormatError(self.path, f"{self.stream.topic.name}: {reason}")
            yield packet

    def _check_order(self, t: np.ndarray) -> None:
        """If `strict`, FormatError for times that fall so far that windows would miss events."""
        if self.strict and not is_sorted(t):
            back = np.maximum.accumulate(t) - t
            at = int(back.argmax())
            if back[at] > BACK_US:
                reason = f"the time falls by {back[at]} µs to {t[at]} µs: the clock was set back, or a time is damaged"
                raise FormatError(self.path, f"{self.stream.topic.name}: {reason}")

    def decode_window(self, start: int, stop: int) -> Columns | None:
        if not self.strict:
            return None
        columns = sort_by_time(self._of_messages(self.stream.within(start, stop)))
        a, b = columns.t.searchsorted(start), columns.t.searchsorted(stop)
        return columns.take(slice(a, b))

    def decode_span(self) -> tuple[int, int] | None:
        if not self.strict:
            return None
        some = (bounds for n in range(len(self.stream)) if (bounds := self.stream.bounds(n)) is not None)
        first = next(some, None)
        if first is None:
            return 0, 0
        last = next(b for n in reversed(range(len(self.stream))) if (b := self.stream.bounds(n)) is not None)
        # events of other messages may be somewhat earlier or later
        head, tail = self.decode_window(EVER[0], first[0] + 1), self.decode_window(last[1], EVER[1])
        assert head is not None
        assert tail is not None
        return int(head.t[0]), int(tail.t[-1])


def groups(packets: Iterable[PackedEvents]) -> Iterator[list[PackedEvents]]:
    """Yield messages in groups of some 1 MiB, because decoding a short array takes as long as one of 1,000 events."""
    group: list[PackedEvents] = []
    size = 0
    for packet in packets:
        group.append(packet)
        size += sum(map(len, packet.data))
        if size >= PIECE:
            yield group
            group, size = [], 0
    if group:
        yield group


class Words:
    """The EVT3 words of a topic's messages, one after the other, as the content of a file without header."""

    stamp = None  # no index is cached

    def __init__(self, stream: TopicMessages[PackedEvents]) -> None:
        self.path = stream.bag.path
        self._stream = stream
        self.size = sum(len(part) for part in self._parts())
        self.damaged = stream.damaged

    def drop_head(self) -> None:
        """Do nothing: there is no head."""

    def _parts(self) -> Iterator[memoryview | bytes]:
        for packet in self._stream.items():
            if packet.encoding != "evt3":
                raise FormatError(self.path, f"{self._stream.topic.name}: messages of evt3 and of {packet.encoding}")
            yield from packet.data

    def pieces(self, start: int, stop: int, step: int) -> Iterator[np.ndarray]:
        """Yield bytes start..stop in pieces of `step` bytes."""
        waiting, at = bytearray(), 0
        for part in self._parts():
            begin, end = max(start - at, 0), min(stop - at, len(part))
            at += len(part)
            if begin < end:
                waiting += part[begin:end]
            while len(waiting) >= step:
                yield np.frombuffer(bytes(waiting[:step]), np.uint8)
                del waiting[:step]
            if at >= stop:
                break
        if waiting:
            yield np.frombuffer(bytes(waiting), np.uint8)


class RosWords(Evt3Recording):
    """The events of a topic of EVT3 packets, which are decoded like a `.raw` file."""

    def __init__(self, bag: Bag, topic: Topic, sensor_size: tuple[int, int] | None, strict: bool) -> None:
        words = Words(TopicMessages(bag, topic, unpack_packet, lambda _: None, strict))
        # there is no header to read
        RecordFile.__init__(self, words, sensor_size, strict)  # type: ignore[arg-type]
        self._repair("damaged messages of events, left out", words.damaged)
