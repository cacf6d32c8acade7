"""ROS bags that rosbags writes, of messages that its own types serialize."""

from itertools import count

import numpy as np

from nvsdata.formats.ros.messages import DEFINITIONS, EVENTS, PACKETS

WAYS = ("bag", "mcap", "db3")
EPOCH = 1_600_000_000_000_000  # µs


def store(way):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    found = get_typestore(Stores.ROS1_NOETIC if way == "bag" else Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        found.register(get_types_from_msg(text, name))
    return found


class Types:
    """Makes messages of one version of ROS."""

    def __init__(self, way):
        self.way, self.store = way, store(way)
        self._seq = count()

    def of(self, name):
        return self.store.types[name]

    def time(self, ns):
        return self.of("builtin_interfaces/msg/Time")(sec=ns // 10**9, nanosec=ns % 10**9)

    def header(self, ns, frame="cam"):
        more = {"seq": next(self._seq)} if self.way == "bag" else {}
        return self.of("std_msgs/msg/Header")(stamp=self.time(ns), frame_id=frame, **more)

    def events(self, t, x, y, p, size, name=EVENTS[0], stamp=None, frame="cam"):
        kind = self.of(name.replace("EventArray", "Event"))
        rows = zip(*(np.asarray(c).tolist() for c in (t, x, y, p)), strict=True)
        made = [kind(x=b, y=c, ts=self.time(a * 1000), polarity=bool(d)) for a, b, c, d in rows]
        ns = int(t[0]) * 1000 if stamp is None and len(t) else stamp or 0
        return self.of(name)(header=self.header(ns, frame), height=size[1], width=size[0], events=made)

    def packet(self, data, size, encoding, base=0, stamp=0, reverse=False, frame="cam", name=PACKETS[0]):
        about = {"height": size[1], "width": size[0], "seq": 0, "time_base": base, "encoding": encoding}
        data = np.frombuffer(bytes(data), np.uint8)
        return self.of(name)(header=self.header(stamp, frame), is_bigendian=reverse, events=data, **about)

    def imu(self, ns, rotation, acceleration):
        vector, turn = self.of("geometry_msgs/msg/Vector3"), self.of("geometry_msgs/msg/Quaternion")
        return self.of("sensor_msgs/msg/Imu")(
            header=self.header(ns),
            orientation=turn(x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=np.zeros(9),
            angular_velocity=vector(*map(float, rotation)),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vector(*map(float, acceleration)),
            linear_acceleration_covariance=np.zeros(9),
        )

    def image(self, ns, pixels, encoding="mono8"):
        data = np.ascontiguousarray(pixels)
        about = {"height": data.shape[0], "width": data.shape[1], "encoding": encoding, "is_bigendian": 0}
        raw = np.frombuffer(data.tobytes(), np.uint8)
        step = data.nbytes // data.shape[0]
        return self.of("sensor_msgs/msg/Image")(header=self.header(ns), step=step, data=raw, **about)

    def compressed(self, ns, data, form="jpeg"):
        raw = np.frombuffer(bytes(data), np.uint8)
        return self.of("sensor_msgs/msg/CompressedImage")(header=self.header(ns), format=form, data=raw)

    def raw(self, message):
        """The bytes of a message."""
        name = message.__msgtype__
        made = (
            self.store.serialize_ros1(message, name) if self.way == "bag" else self.store.serialize_cdr(message, name)
        )
        return bytes(made)

    def read(self, raw, name):
        """A message of its bytes, as rosbags reads it."""
        return (self.store.deserialize_ros1 if self.way == "bag" else self.store.deserialize_cdr)(raw, name)


TYPES = {}


def types_of(way):
    """The types of a version of ROS, made once."""
    return TYPES.setdefault(way, Types(way))


def some(types, count=40, each=30):
    """Messages of events, frames and inertial samples."""
    rng, found = np.random.default_rng(5), []
    for k in range(count):
        t = EPOCH + 1_000 * k + np.arange(each)
        columns = t, rng.integers(0, 64, each), rng.integers(0, 48, each), rng.integers(0, 2, each)
        found.append(("/dvs/events", k, types.events(*columns, (64, 48))))
    found.append(("/dvs/image", 9, types.image(EPOCH * 1000, rng.integers(0, 256, (48, 64), np.uint8))))
    found.append(("/dvs/imu", 9, types.imu(EPOCH * 1000, (1, 2, 3), (4, 5, 6))))
    return found


def content(path):
    """The file of a bag that has its messages."""
    return path if path.is_file() else next(f for f in path.iterdir() if f.name != "metadata.yaml")


class Raw(bytes):
    """The bytes of a message of a type."""

    def __new__(cls, kind, data):
        made = super().__new__(cls, data)
        made.__msgtype__ = kind
        return made


def write_bag(folder, types, messages, *, compression=None, name="a"):
    """Write messages (topic, time of the bag in ns, message); return the path of the bag."""
    topics = {topic: message.__msgtype__ for topic, _, message in messages}
    with _writer(folder, types, compression, name) as (writer, path):
        known = {}
        for topic, kind in topics.items():
            known[topic] = writer.add_connection(topic, kind, typestore=types.store)
        for topic, time, message in messages:
            data = message if isinstance(message, bytes) else types.raw(message)
            writer.write(known[topic], time, data)
    return path


class _writer:
    def __init__(self, folder, types, compression, name):
        self.path = folder / (f"{name}.bag" if types.way == "bag" else f"{name}_{types.way}")
        if types.way == "bag":
            from rosbags.rosbag1 import Writer

            self.writer = Writer(self.path)
            if compression:
                self.writer.set_compression(getattr(Writer.CompressionFormat, compression.upper()))
        else:
            from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

            plugin = StoragePlugin.MCAP if types.way == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer(self.path, version=9, storage_plugin=plugin)
            if compression:
                self.writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)

    def __enter__(self):
        self.writer.open()
        return self.writer, self.path

    def __exit__(self, *_):
        self.writer.close()
