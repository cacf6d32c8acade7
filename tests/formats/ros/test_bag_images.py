"""Compressed frames of ROS bags, compared with OpenCV's own writer."""

import struct

import cv2
import numpy as np
import pytest
from rosbag_files import EPOCH, WAYS, Types, types_of, write_bag

import nvsdata
from nvsdata import FormatError
from nvsdata.formats.ros import images

pytest.importorskip("rosbags")
GRAY = np.random.default_rng(0).integers(0, 256, (48, 64), np.uint8)
COLOR = np.random.default_rng(1).integers(0, 256, (48, 64, 3), np.uint8)
DEEP = np.random.default_rng(2).integers(0, 1 << 16, (48, 64), np.uint16)
SETTINGS = {
    "baseline": [],
    "progressive": [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
    "restarts": [cv2.IMWRITE_JPEG_RST_INTERVAL, 2],
    "optimized": [cv2.IMWRITE_JPEG_OPTIMIZE, 1],
}


def encoded(pixels, suffix=".jpg", settings=()):
    return cv2.imencode(suffix, pixels, settings)[1].tobytes()


def unpacked(data, form="jpeg"):
    types = types_of("mcap")
    return images.unpack_compressed(types.raw(types.compressed(5_999, data, form)), True)


def bag(tmp_path, types, messages):
    event = types.events([EPOCH], [1], [2], [1], (64, 48))
    return write_bag(tmp_path, types, [("/dvs/events", 0, event), *messages])


@pytest.mark.parametrize("way", WAYS)
def test_windows_of_compressed_frames(tmp_path, way):
    types = Types(way)
    messages = [
        ("/dvs/image_raw/compressed", k, types.compressed((EPOCH + 200_000 * k) * 1000, encoded(pixels, ".png"), form))
        for k, (pixels, form) in enumerate([(GRAY, "png"), (COLOR, "bgr8; png compressed bgr8"), (DEEP, "16UC1; png")])
    ]
    recording = nvsdata.open(bag(tmp_path, types, messages))
    assert recording.holds_samples
    wanted = [GRAY, cv2.cvtColor(COLOR, cv2.COLOR_BGR2GRAY), DEEP]
    frames = list(recording.frames())
    assert [frame.start for frame in frames] == [EPOCH + 200_000 * k for k in range(3)]
    for frame, pixels in zip(frames, wanted, strict=True):
        # the decoder of PNG rounds the luminance of colors in its own way
        np.testing.assert_allclose(frame.pixels.astype(int), pixels, atol=pixels is wanted[1], rtol=0)
    (one,) = recording.frames(EPOCH + 100_000, EPOCH + 300_000)
    np.testing.assert_array_equal(one.pixels, frames[1].pixels)


def test_frames_that_arent_compressed_come_first(tmp_path):
    types = Types("bag")
    messages = [
        ("/dvs/image_raw/compressed", 1, types.compressed(1, encoded(GRAY))),
        ("/dvs/image_raw", 2, types.image(1, GRAY[:6, :8])),
    ]
    (frame,) = nvsdata.open(bag(tmp_path, types, messages)).frames()
    assert frame.pixels.shape == (6, 8)


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("pixels", [GRAY, COLOR], ids=["gray", "color"])
def test_jpeg(pixels, settings):
    data = encoded(pixels, settings=settings)
    frame = unpacked(data)
    np.testing.assert_array_equal(frame.pixels, cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE))
    assert frame.start == frame.end == 5


def test_a_turned_frame_keeps_the_sensors_orientation():
    """A phone's orientation in the metadata would exchange width and height."""
    exif = b"Exif\0\0II*\0\x08\0\0\0\1\0\x12\1\3\0\1\0\0\0\6\0\0\0\0\0\0\0"
    data = encoded(GRAY)
    turned = data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]
    np.testing.assert_array_equal(unpacked(turned).pixels, unpacked(data).pixels)
    assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_GRAYSCALE).shape == (64, 48)


def test_frames_that_cant_be_decoded(monkeypatch):
    png = encoded(GRAY, ".png")
    huge = png[:16] + struct.pack(">II", 1 << 15, 1 << 15) + png[24:]
    jpeg = encoded(GRAY)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was decoded"))
    for data, error, says in (
        (huge, ValueError, "a frame of 32768x32768 pixels"),
        (png[:16] + bytes(8) + png[24:], ValueError, "a frame of 0x0 pixels"),
        (b"RIFF1234WEBP", NotImplementedError, "a frame of format 'webp'; known are jpeg and png"),
        (b"", NotImplementedError, "a frame of format 'webp'"),
        (png[:20], struct.error, "requires a buffer"),
        (jpeg[:20], struct.error, "requires a buffer"),
        (jpeg[:2] + bytes(40), ValueError, "a JPEG frame without a size"),
    ):
        with pytest.raises(error, match=says):
            unpacked(data, "webp")


@pytest.mark.parametrize("mark", [0x00, 0x01, 0xD0, 0xD9])
def test_a_size_that_is_no_marker_of_the_frame_is_not_taken(monkeypatch, mark):
    """The decoder skips markers without a length; what follows them, taken as one, leads into a comment."""
    jpeg = encoded(GRAY)
    at = jpeg.index(b"\xff\xc0")
    size = jpeg[at : at + 19]
    huge = size[:5] + struct.pack(">HH", 16_000, 16_000) + size[9:]
    before = jpeg[:2] + bytes([0xFF, mark]) + huge
    # the length is 0xffc0
    filling = bytes(0xFFC0 + 4 - len(before) - 4)
    comment = b"\xff\xfe" + struct.pack(">H", 2 + len(filling) + len(size)) + filling + size
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was decoded"))
    with pytest.raises(ValueError, match="a JPEG frame without a size"):
        unpacked(before + comment + jpeg[2:])


def test_markers_may_be_padded_but_not_without_end():
    jpeg = encoded(GRAY)
    np.testing.assert_array_equal(unpacked(jpeg[:2] + b"\xff" * 1_000 + jpeg[2:]).pixels, unpacked(jpeg).pixels)
    with pytest.raises(ValueError, match="a JPEG frame without a size"):
        unpacked(jpeg[:2] + b"\xff" * images.MOST_MARKERS + jpeg[2:])


def test_damaged_frames_are_named_or_left_out(tmp_path):
    types = Types("mcap")
    messages = [
        ("/image/compressed", k, types.compressed((EPOCH + k) * 1000, data, "png"))
        for k, data in enumerate([encoded(GRAY, ".png"), encoded(GRAY, ".png")[:40]])
    ]
    path = bag(tmp_path, types, messages)
    with pytest.raises(FormatError, match=r"/image/compressed, message 1: damaged: .*'png' that OpenCV can't decode"):
        list(nvsdata.open(path).frames())
    recording = nvsdata.open(path, strict=False)
    assert len(list(recording.frames())) == 1
    assert recording.repairs == {"damaged messages of sensor_msgs/msg/CompressedImage, left out": 1}
