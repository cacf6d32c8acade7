"""`BagRecording`: the events, frames, inertial samples and triggers of a ROS bag."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import EVER, Columns, check_window
from nvsdata.data.samples import Frame, Inertial, Triggers, within
from nvsdata.formats.file_recording import FileRecording
from nvsdata.formats.records import stated_size
from nvsdata.formats.registry import split_stream
from nvsdata.formats.ros.containers import Bag, Topic
from nvsdata.formats.ros.events import RosEvents, RosWords, triggers_of
from nvsdata.formats.ros.images import COMPRESSED, IMAGE, unpack_compressed, unpack_image
from nvsdata.formats.ros.messages import (
    DEFINITIONS,
    IMU,
    PACKETS,
    PackedEvents,
    unpack_events,
    unpack_imu,
    unpack_packet,
)
from nvsdata.formats.ros.topics import Item, TopicMessages, nearest_topic
from nvsdata.kernels.decode.clock import BACK_US


class BagRecording(FileRecording):
    """A ROS bag. Its events are those of one topic, of which the path may name one: `stereo.bag#/dvs/left/events`.

    Frames, inertial samples and triggers are read from one topic each, the one whose name is most like that of the
    events. dvs_msgs and prophesee_event_msgs have times since 1970. event_camera_msgs has times of the camera's clock.
    There, the times of frames and inertial samples, which are times since 1970, are moved to the camera's clock by the
    first message of events.
    """

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        path, self._wanted = split_stream(path)
        if os.path.basename(path) == "metadata.yaml":
            path = os.path.dirname(path) or "."
        super().__init__(path, sensor_size, strict)
        self._bag = Bag(path, head)
        self.format = "rosbag2" if self._bag.cdr else "rosbag"
        self._topic = self._chosen()
        for topic in (self._topic, *self._of_triggers):
            self._bag.check_definition(topic, DEFINITIONS[topic.kind])
        self._first = self._first_packet(self._topic)
        if self._size is None and self._first is not None and all(self._first.size):
            self._size = stated_size(path, *self._first.size)
        self._imu, self._images = self._nearest(IMU), self._nearest(IMAGE, COMPRESSED)

    def _of_kind(self, *kinds: str) -> list[Topic]:
        return [topic for topic in self._bag.topics if topic.kind in kinds and len(topic.messages)]

    def _first_packet(self, topic: Topic) -> PackedEvents | None:
        """Return the first message of a topic of events or triggers; None if it is damaged and not `strict`."""
        unpack = unpack_packet if topic.kind in PACKETS else unpack_events
        return next(TopicMessages(self._bag, topic, unpack, lambda _: None, self.strict).items(), None)

    @cached_property
    def _encodings(self) -> dict[str, str]:
        """The encoding of each topic of event_camera_msgs, by its first message."""
        found = ((topic.name, self._first_packet(topic)) for topic in self._of_kind(*PACKETS))
        return {name: "" if packet is None else packet.encoding for name, packet in found}

    @property
    def _of_triggers(self) -> list[Topic]:
        return [topic for topic in self._of_kind(*PACKETS) if self._triggers(topic)]

    def _chosen(self) -> Topic:
        """Return the topic of events: the one that the path names, or the only one. FormatError if there is none."""
        topics = self._bag.topics
        if self._wanted:
            named = [topic for topic in topics if topic.name == self._wanted]
            if not named:
                raise FormatError(self.path, f"no topic {self._wanted}; there are {_listed(topics)}")
            topics = named
        events = [topic for topic in self._of_kind(*DEFINITIONS) if topic in topics and not self._triggers(topic)]
        if not events:
            known = ", ".join(DEFINITIONS)
            raise FormatError(self.path, f"no topic of events ({known}); there are {_listed(topics)}")
        if len(events) > 1:
            name = f"{os.path.basename(os.path.normpath(self.path))}#{events[0].name}"
            raise FormatError(self.path, f"events on {_listed(events)}: choose a topic, as in {name}")
        return events[0]

    def _triggers(self, topic: Topic) -> bool:
        return topic.kind in PACKETS and self._encodings[topic.name] == "trigger"

    def _nearest(self, *kinds: str) -> Topic | None:
        """Return the topic whose name is most like that of the events, of several the one of the first kind."""
        topics = sorted(self._of_kind(*kinds), key=lambda topic: kinds.index(topic.kind))
        return nearest_topic(topics, self._topic.name)

    @property
    def holds_samples(self) -> bool:  # type: ignore[override]
        """True if the bag has frames or inertial samples."""
        return self._images is not None or self._imu is not None

    @property
    def holds_triggers(self) -> bool:  # type: ignore[override]
        """True if the bag has a topic of triggers, or of EVT3 words, which may contain some."""
        return bool(self._of_triggers) or (self._first is not None and self._first.encoding == "evt3")

    @property
    def about(self) -> Mapping[str, Any]:
        return {}

    @cached_property
    def _events(self) -> RosEvents | RosWords:
        kind = RosWords if self._first is not None and self._first.encoding == "evt3" else RosEvents
        with self._named():
            found = kind(self._bag, self._topic, self._size, self.strict)
        self.repairs |= found.repairs
        found.repairs = self.repairs
        return found

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Name the topic in errors of EVT3 words, whose offsets aren't those of the file."""
        try:
            yield
        except FormatError as error:
            if error.offset is None:
                raise
            raise FormatError(self.path, f"{self._topic.name}: {error.reason}") from error

    def decode(self) -> Columns:
        with self._named():
            return self._events.decode()

    def decode_window(self, start: int, stop: int) -> Columns | None:
        with self._named():
            return self._events.decode_window(start, stop)

    def decode_span(self) -> tuple[int, int] | None:
        with self._named():
            return self._events.decode_span()

    @cached_property
    def _shift(self) -> int:
        """Time in µs since 1970 at the beginning of the events' clock."""
        first = self._first
        if first is None or first.encoding == "events":
            return 0
        if first.encoding == "evt3":
            return first.stamp // 1000 - self.span[0]
        return (first.stamp - first.base) // 1000

    def _window(self, stream: TopicMessages[Item], start: int | None, stop: int | None) -> Iterator[Item]:
        """Yield the messages in a window; if not `strict`, all."""
        check_window(start, stop)
        if self.strict:
            yield from stream.items(stream.within(*self._absolute(start, stop)))
        else:
            yield from stream.items()
            self._repair(f"damaged messages of {stream.topic.kind}, left out", stream.damaged)

    def _absolute(self, start: int | None, stop: int | None) -> tuple[int, int]:
        lo, hi = EVER[0] // 2, EVER[1] // 2
        return lo if start is None else max(start + self._shift, lo), hi if stop is None else min(
            stop + self._shift, hi
        )

    def frames(self, start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        check_window(start, stop)
        if self._images is None:
            return iter(())
        unpack = unpack_image if self._images.kind == IMAGE else unpack_compressed
        stream = TopicMessages(self._bag, self._images, unpack, _when, self.strict)
        return within(self._shifted(self._window(stream, start, stop)), start, stop)

    def _shifted(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        latest = EVER[0]
        for frame in frames:
            self._check_step(latest, frame.start, "frames")
            latest = max(latest, frame.start)
            yield frame.shifted(self._shift)

    def _check_step(self, before: int, after: int, what: str) -> None:
        """If `strict`, FormatError if the time falls so far that windows would miss messages."""
        if self.strict and before - after > BACK_US:
            raise FormatError(self.path, f"{what}: the time falls from {before} to {after} µs: the clock was set back")

    def inertial(self, start: int | None = None, stop: int | None = None) -> Inertial:
        check_window(start, stop)
        if self._imu is None:
            return Inertial.empty()
        stream = TopicMessages(
            self._bag, self._imu, unpack_imu, lambda one: (int(one.t[0]), int(one.t[0])), self.strict
        )
        found = Inertial.joined(list(self._window(stream, start, stop)))
        highest = np.maximum.accumulate(found.t)
        for at in np.flatnonzero(highest - found.t > BACK_US)[:1].tolist():
            self._check_step(int(highest[at]), int(found.t[at]), "inertial samples")
        return found.shifted(self._shift).window(start, stop)

    def triggers(self, start: int | None = None, stop: int | None = None) -> Triggers:
        check_window(start, stop)
        found = []
        if isinstance(self._events, RosWords):
            with self._named():
                found.append(self._events.triggers())
        topic = nearest_topic(self._of_triggers, self._topic.name)
        if topic is not None:
            stream = TopicMessages(self._bag, topic, unpack_packet, lambda _: None, self.strict)
            found += [triggers_of(packet) for packet in stream.items()]
        return Triggers.joined(found).window(start, stop)


def _when(frame: Frame) -> tuple[int, int]:
    return frame.start, frame.start


def _listed(topics: list[Topic]) -> str:
    return ", ".join(f"{topic.name} ({topic.kind})" for topic in topics) or "none"
