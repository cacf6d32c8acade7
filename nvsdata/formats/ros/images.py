"""Frames in ROS messages, uncompressed and compressed."""

from __future__ import annotations

import struct

import numpy as np

from nvsdata.data.samples import Frame
from nvsdata.formats.ros.messages import Cursor

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CHANNELS = {"mono8": 1, "8UC1": 1, "mono16": 1, "16UC1": 1, "rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4}
BAYER = ("bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8")
PNG, JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"  # first bytes
SIZES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # markers of JPEG that are followed by the frame's size
NO_LENGTH = {0x00, 0x01, *range(0xD0, 0xDA)}  # markers of JPEG without a length, which aren't expected before the size
MOST_PIXELS = 1 << 24  # a small file may state far more
MOST_MARKERS = 1 << 16  # of a JPEG before its size, with bytes that pad them


def unpack_image(raw: bytes | memoryview, cdr: bool) -> Frame:
    """Return the frame of a sensor_msgs/Image; colors become gray. Its exposure is unknown: all times are the stamp."""
    cursor = Cursor(raw, cdr)
    stamp, height, width, encoding = cursor.header(), cursor.number("I"), cursor.number("I"), cursor.text()
    reverse, step = cursor.number("B"), cursor.number("I")
    data = cursor.bytes(cursor.number("I"))
    channels = CHANNELS.get(encoding, 1 if encoding in BAYER else 0)
    if not channels:
        raise NotImplementedError(f"a frame of encoding {encoding[:40]!r}; known are {', '.join((*CHANNELS, *BAYER))}")
    kind = np.dtype((">u2" if reverse else "<u2") if "16" in encoding else "u1")
    row = width * channels * kind.itemsize
    if min(width, height) < 1 or step < row or step * height != len(data):
        raise ValueError(f"a frame of {width}x{height} pixels of {encoding}, rows of {step} bytes, in {len(data)}")
    rows = np.frombuffer(data, np.uint8).reshape(height, step)[:, :row]
    pixels = np.ascontiguousarray(rows).view(kind).reshape(height, width, channels)
    return _frame(stamp, _gray(pixels, encoding))


def unpack_compressed(raw: bytes | memoryview, cdr: bool) -> Frame:
    """Return the frame of a sensor_msgs/CompressedImage, as `unpack_image` does."""
    cursor = Cursor(raw, cdr)
    stamp, how = cursor.header(), cursor.text()
    data = cursor.bytes(cursor.number("I"))
    width, height = _size(data, how)
    if not 1 <= width * height <= MOST_PIXELS:
        raise ValueError(f"a frame of {width}x{height} pixels")
    import cv2

    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if pixels is None or pixels.dtype.kind != "u":
        raise ValueError(f"a frame of {len(data)} bytes of {how[:40]!r} that OpenCV can't decode")
    return _frame(stamp, pixels)


def _size(data: memoryview, how: str) -> tuple[int, int]:
    """Return (width, height) in pixels that an image in PNG or JPEG states, so that no other size is allocated."""
    if bytes(data[:8]) == PNG:
        width, height = struct.unpack_from(">II", data, 16)
        return width, height
    if bytes(data[:2]) != JPEG:
        raise NotImplementedError(f"a frame of format {how[:40]!r}; known are jpeg and png")
    at = 2
    for _ in range(MOST_MARKERS):
        mark, kind, length = struct.unpack_from(">BBH", data, at)
        if mark != 0xFF or kind in NO_LENGTH:
            break
        if kind in SIZES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        # a marker may be padded by bytes of 255
        at += 1 if kind == 0xFF else 2 + length
    raise ValueError("a JPEG frame without a size")


def _frame(stamp: int, pixels: np.ndarray) -> Frame:
    time = stamp // 1000
    return Frame(time, time, time, time, 0, 0, pixels.astype(np.uint16))


def _gray(pixels: np.ndarray, encoding: str) -> np.ndarray:
    if encoding not in BAYER and pixels.shape[2] == 1:
        return pixels[..., 0]
    import cv2

    # OpenCV names Bayer patterns by their second row
    patterns = (cv2.COLOR_BayerBG2GRAY, cv2.COLOR_BayerRG2GRAY, cv2.COLOR_BayerGR2GRAY, cv2.COLOR_BayerGB2GRAY)
    how = dict(zip(BAYER, patterns, strict=True)) | {
        "rgb8": cv2.COLOR_RGB2GRAY,
        "bgr8": cv2.COLOR_BGR2GRAY,
        "rgba8": cv2.COLOR_RGBA2GRAY,
        "bgra8": cv2.COLOR_BGRA2GRAY,
    }
    gray: np.ndarray = cv2.cvtColor(pixels[..., 0] if encoding in BAYER else pixels, how[encoding])
    return gray
