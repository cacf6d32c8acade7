import cv2
import numpy as np
import pytest
from clips import moving_square, write_video

from nvsdata import FormatError
from nvsdata.emulation import PIX2NVS
from nvsdata.video.frames import TruncatedVideo, frames_of


def test_a_file_gives_its_frames_and_times(tmp_path):
    frames = list(frames_of(write_video(tmp_path / "a.avi", fps=20)))
    assert [frame.time for frame in frames] == [50_000 * n for n in range(12)]
    for frame, drawn in zip(frames, moving_square(), strict=True):
        assert np.abs(frame.pixels.astype(int) - drawn).mean() < 6  # JPEG
    assert [frame.time for frame in frames_of(tmp_path / "a.avi", fps=1000)] == [1000 * n for n in range(12)]


class FakeCapture:
    """A container with times of its own."""

    stamps = (100.0, 140.5, 141.0, 141.0, 300.0)  # ms; one is given twice
    promised = 5.0

    def __init__(self, *_):
        self.n = -1

    def isOpened(self):
        return True

    def read(self):
        self.n += 1
        ok = self.n < len(self.stamps)
        return ok, np.full((4, 6, 3), 10 * self.n + 10, np.uint8) if ok else None

    def get(self, what):
        return {
            cv2.CAP_PROP_FPS: 25.0,
            cv2.CAP_PROP_FRAME_WIDTH: 6.0,
            cv2.CAP_PROP_FRAME_HEIGHT: 4.0,
            cv2.CAP_PROP_FRAME_COUNT: self.promised,
            cv2.CAP_PROP_POS_MSEC: self.stamps[min(self.n, len(self.stamps) - 1)],
        }[what]

    def release(self):
        pass


def test_variable_frame_rate_keeps_the_times_of_the_container(tmp_path, monkeypatch):
    (tmp_path / "a.mkv").touch()
    monkeypatch.setattr(cv2, "VideoCapture", FakeCapture)
    assert [frame.time for frame in frames_of(tmp_path / "a.mkv")] == [0, 40_500, 41_000, 81_000, 200_000]


def test_a_container_without_times_goes_by_its_rate(tmp_path, monkeypatch):
    (tmp_path / "a.mkv").touch()
    monkeypatch.setattr(cv2, "VideoCapture", FakeCapture)
    monkeypatch.setattr(FakeCapture, "stamps", (0.0,) * 5)
    assert [frame.time for frame in frames_of(tmp_path / "a.mkv")] == [40_000 * n for n in range(5)]


def test_an_estimate_of_the_frames_is_no_promise(tmp_path, monkeypatch):
    """As Matroska's, of a variable rate: the time that it lasts, at the usual rate."""
    (tmp_path / "a.mkv").touch()
    monkeypatch.setattr(cv2, "VideoCapture", FakeCapture)
    monkeypatch.setattr(FakeCapture, "stamps", (0.0, 500.0, 510.0, 1_100.0, 2_000.0))
    monkeypatch.setattr(FakeCapture, "promised", 51.0)
    assert [frame.time for frame in frames_of(tmp_path / "a.mkv")] == [0, 500_000, 510_000, 1_100_000, 2_000_000]
    monkeypatch.setattr(FakeCapture, "promised", 80.0)
    with pytest.raises(TruncatedVideo, match="ends after 5 of 80 frames"):
        list(frames_of(tmp_path / "a.mkv"))


def test_a_video_that_is_cut_off_says_so_after_its_last_frame(tmp_path):
    path = write_video(tmp_path / "a.avi", moving_square(60))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    found = []
    with pytest.raises(TruncatedVideo, match=r"a\.avi: ends after \d+ of 60 frames"):
        found.extend(frames_of(path))
    assert 20 < len(found) < 40


def test_what_is_no_video(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such video"):
        PIX2NVS().emulate(tmp_path / "none.avi")
    with pytest.raises(FormatError, match="is a folder"):
        PIX2NVS().emulate(tmp_path)
    (tmp_path / "a.mp4").write_bytes(b"not a video at all" * 50)
    with pytest.raises(FormatError, match="holds no video"):
        PIX2NVS().emulate(tmp_path / "a.mp4")
    head = write_video(tmp_path / "b.avi").read_bytes()
    (tmp_path / "b.avi").write_bytes(head[:600])
    with pytest.raises(FormatError, match=r"holds no video|not one frame"):
        PIX2NVS().emulate(tmp_path / "b.avi")


def test_image_files_are_frames(tmp_path):
    frames = moving_square(4)
    for n, frame in enumerate(frames):
        cv2.imwrite(str(tmp_path / f"{n}.png"), frame[..., ::-1])  # the file has red first, too
    of_files = PIX2NVS().emulate(sorted(tmp_path.glob("*.png")), fps=30)
    assert of_files == PIX2NVS().emulate(frames, fps=30)
    (tmp_path / "2.png").write_bytes(b"?")
    with pytest.raises(FormatError, match=r"2\.png: holds no image"):
        PIX2NVS().emulate(sorted(tmp_path.glob("*.png")))
    with pytest.raises(FileNotFoundError, match="no such image"):
        PIX2NVS().emulate([tmp_path / "none.png"])


def test_frames_can_be_scaled(tmp_path):
    events = PIX2NVS().emulate(write_video(tmp_path / "a.avi"), size=(32, 24))
    assert events.sensor_size == (32, 24)
    assert len(events)
    with pytest.raises(ValueError, match="size must be"):
        PIX2NVS().emulate(tmp_path / "a.avi", size=(0, 5))
    with pytest.raises(ValueError, match="fps must be"):
        PIX2NVS().emulate(tmp_path / "a.avi", fps=0)
    with pytest.raises(ValueError, match="not both"):
        list(PIX2NVS().stream(tmp_path / "a.avi", 5, times=[1]))


def test_leaving_a_stream_early_stops_its_threads(tmp_path):
    import threading

    before = threading.active_count()
    stream = PIX2NVS().stream(write_video(tmp_path / "a.avi", moving_square(60)))
    next(stream)
    stream.close()
    assert threading.active_count() == before


def test_a_camera_s_frames_have_the_times_at_which_they_came(monkeypatch):
    class Webcam:
        left = 3

        def __init__(self, number):
            self.number = number

        def isOpened(self):
            return self.number == 1

        def read(self):
            self.left -= 1
            return self.left >= 0, np.full((4, 6, 3), max(self.left, 0), np.uint8)

        def release(self):
            pass

    clock = iter([5_000, 5_000, 1_005_999, 40_005_000])
    monkeypatch.setattr(cv2, "VideoCapture", Webcam)
    monkeypatch.setattr("nvsdata.video.frames.time.monotonic_ns", lambda: next(clock))
    found = list(frames_of(1))
    assert [frame.time for frame in found] == [0, 1_000, 40_000]
    assert [int(frame.pixels[0, 0, 0]) for frame in found] == [2, 1, 0]
    with pytest.raises(FileNotFoundError, match="no camera 2"):
        next(frames_of(2))
