"""ROS bags without ROS, with the package rosbags (extra `ros`): ROS 1 (`.bag`) and ROS 2 (a folder, `.mcap`, `.db3`).

Events are read from dvs_msgs and prophesee_event_msgs (EventArray) and event_camera_msgs (EventPacket: evt3, mono).
The modules of this package are imported when a bag is opened.
"""

from __future__ import annotations

from nvsdata.data.recording import Recording
from nvsdata.formats.registry import Format, starts_with

BEGINNINGS = b"\x89MCAP0\r\n", b"SQLite format 3\0", b"rosbag2_bagfile_information:"


def _open(path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> Recording:
    from nvsdata.formats.ros.recording import BagRecording

    return BagRecording(path, sensor_size, head, strict)


ROS1 = Format(
    "rosbag",
    (".bag",),
    _open,
    begins=starts_with(b"#ROSBAG V2.0\n"),
    holds_samples=True,
    has_streams=True,
    packages=("rosbags",),
)
ROS2 = Format(
    "rosbag2",
    (".mcap", ".db3"),
    _open,
    begins=lambda head: head.startswith(BEGINNINGS),
    holds_samples=True,
    has_streams=True,
    packages=("rosbags",),
)
