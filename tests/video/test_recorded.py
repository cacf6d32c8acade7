"""Frames with times in a camera's own clock: in recordings, and in folders of images."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import nvsdata
from nvsdata.common.errors import FormatError
from nvsdata.data.samples import Frame as Sample
from nvsdata.emulation import DVS, PIX2NVS, fit
from nvsdata.video.frames import frames_of

SHARED = Path(__file__).parents[3] / "shared" / "data" / "pairs"


def folder(tmp_path, listed, names=("frame_1.png", "frame_2.png", "frame_10.png"), file="images.txt"):
    for n, name in enumerate(names):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / name), np.full((6, 8), 10 * (n + 1), np.uint8))
    (tmp_path / file).write_text(listed)
    return tmp_path


@pytest.mark.parametrize(
    ("file", "listed", "times"),
    [
        ("images.txt", "0.5 frame_1.png\n0.533334 frame_2.png\n0.7 frame_10.png\n", [500_000, 533_334, 700_000]),
        ("images.txt", "# t name\n\nframe_1.png, 5\nframe_2.png, 7 # x\nframe_10.png 9", [5, 7, 9]),
        ("images.txt", "frame_2.png 5\nframe_10.png 7\n", [5, 7]),
        ("timestamps.txt", "100\n50100\n100100\n", [100, 50_100, 100_100]),
        ("timestamps.txt", "0 100\n1 50100\n2 100100\n", [100, 50_100, 100_100]),
        ("timestamps.txt", "1000000000000\n1000050000000\n1000100000000", [10**9, 10**9 + 50_000, 10**9 + 100_000]),
        ("image_timestamps.txt", "1589163147.3652264\n1589163147.4052265\n1.6e9", None),
        ("timestamps.txt", "-1.5\n-0.25\n0.000001", [-1_500_000, -250_000, 1]),
    ],
)
def test_times_of_images_are_those_of_their_list(tmp_path, file, listed, times):
    found = list(frames_of(folder(tmp_path, listed, file=file)))
    times = times or [1_589_163_147_365_226, 1_589_163_147_405_227, 1_600_000_000_000_000]
    assert [frame.time for frame in found] == times
    first = 20 if listed.startswith("frame_2") else 10
    assert [int(frame.pixels[0, 0]) for frame in found] == [first + 10 * n for n in range(len(times))]


def test_images_may_stand_in_a_folder_of_their_own(tmp_path):
    names = [f"images/{n}.jpg" for n in (9, 10, 11)]
    found = list(frames_of(folder(tmp_path, "1\n2\n3", names, "timestamps.txt")))
    assert [round(frame.pixels.mean()) for frame in found] == [10, 20, 30]


def test_an_emulator_takes_the_clock_of_the_list(tmp_path):
    path = folder(tmp_path, "5.0 frame_1.png\n5.1 frame_2.png\n5.2 frame_10.png\n")
    events = DVS(on=0.1).emulate(path)
    assert (events.start, events.end) == (5_000_000, 5_200_000)
    assert 5_000_000 < events.t[0] < 5_010_000 + 100_000
    assert PIX2NVS().emulate(path, fps=10).end == 200_000
    assert PIX2NVS().emulate(path, size=(4, 3)).sensor_size == (4, 3)


@pytest.mark.parametrize(
    ("file", "listed", "said"),
    [
        ("other.txt", "1\n2\n3", "is a folder without times of its images: none of images.txt, timestamps.txt"),
        ("timestamps.txt", "", "has no times"),
        ("timestamps.txt", "1\n2\n", "has 3 images and 2 times"),
        ("timestamps.txt", "1\nsoon\n3\n", "line 2 is 'soon', not a time"),
        ("timestamps.txt", "1 2 3\n", "line 1 is '1 2 3', not a time"),
        ("timestamps.txt", "5\n3\n4\n", "time 1 is 3 µs, the one before is 5: times must rise"),
        ("images.txt", "1 frame_1.png\n2\n", "has 1 names and 2 times"),
        ("images.txt", "1 frame_1.png\n2 frame_3.png\n", "frame_3.png: is listed, but missing"),
    ],
)
def test_folders_that_are_no_videos_are_refused_by_name(tmp_path, file, listed, said):
    with pytest.raises(FormatError) as caught:
        list(frames_of(folder(tmp_path, listed, file=file)))
    assert said in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_images_that_cannot_be_decoded_are_named(tmp_path):
    path = folder(tmp_path, "1\n2\n3", file="timestamps.txt")
    (path / "frame_2.png").write_bytes(b"\x89PNG nothing")
    with pytest.raises(FormatError, match=r"frame_2\.png: contains no image that OpenCV can decode"):
        list(frames_of(path))


class Camera:
    """A recording that has nothing but frames."""

    sensor_size = (8, 6)

    def __init__(self, *samples):
        self.samples = samples

    def frames(self):
        return iter(self.samples)

    def __repr__(self):
        return "a camera"


def sample(value, start=1_000, end=3_001, shape=(6, 8)):
    return Sample(start - 100, start, end, end + 900, 0, 0, np.full(shape, value, np.uint16))


@pytest.mark.parametrize(
    ("values", "levels"),
    [((0, 255), (0, 255)), ((0, 1023), (0, 255)), ((256, 512), (63.8, 127.6)), ((0, 65535), (0, 255))],
)
def test_frames_of_a_recording_are_in_the_middle_of_their_exposure(values, levels):
    from nvsdata.video.recorded import read_recording

    found = list(read_recording(Camera(sample(values[0]), sample(values[1], 5_000, 6_000))))
    assert [frame.time for frame in found] == [2_000, 5_500]
    assert [float(frame.pixels[0, 0]) for frame in found] == pytest.approx(levels, abs=0.1)
    assert found[0].pixels.dtype == (np.uint8 if max(values) < 256 else np.float64)


def test_recordings_whose_frames_are_no_video():
    from nvsdata.video.recorded import read_recording

    for camera, said in (
        (Camera(), "a camera has no frames"),
        (Camera(sample(1, shape=(5, 8))), r"frame 0 is 8x5, the sensor \(8, 6\)"),
        (Camera(sample(1), sample(2)), "frame 1 is at 2000 µs, the one before at 2000: times must rise"),
    ):
        with pytest.raises(ValueError, match=said):
            list(read_recording(camera))


@pytest.mark.skipif(not SHARED.exists(), reason="needs real pairs")
def test_a_real_sensor_is_fitted_from_its_own_file():
    recording = nvsdata.open(SHARED / "street_davis346.aedat4")
    found = fit(recording, recording, base=DVS(upsample="flow"), noise=False)
    ours, real = found.settings.emulate(recording), recording.read()
    assert 5_000 < found.delay < 9_000
    assert found.correlation > 0.8
    last = ours.end + found.delay
    during = (real.t >= ours.start + found.delay) & (real.t < last)
    for p in (0, 1):
        assert abs((ours.p == p).sum() / (real.p[during] == p).sum() - 1) < 0.03
