import cv2
import numpy as np
import pytest
from clips import moving_square, write_video
from PIL import Image

from nvsdata import FormatError
from nvsdata.emulation import PIX2NVS
from nvsdata.video.frames import TruncatedVideo, VideoFrame, frames_of


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
    rate = 25.0

    def __init__(self, *_):
        self.n = -1

    def isOpened(self):
        return True

    def read(self):
        self.n += 1
        ok = self.n < len(self.stamps)
        return ok, np.full((4, 6, 3), (10 * self.n + 10) % 256, np.uint8) if ok else None

    def get(self, what):
        return {
            cv2.CAP_PROP_FPS: self.rate,
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
    with pytest.raises(FormatError, match="contains no video"):
        PIX2NVS().emulate(tmp_path / "a.mp4")
    head = write_video(tmp_path / "b.avi").read_bytes()
    (tmp_path / "b.avi").write_bytes(head[:600])
    with pytest.raises(FormatError, match=r"contains no video|no frame"):
        PIX2NVS().emulate(tmp_path / "b.avi")


def test_image_files_are_frames(tmp_path):
    frames = moving_square(4)
    for n, frame in enumerate(frames):
        cv2.imwrite(str(tmp_path / f"{n}.png"), frame[..., ::-1])  # the file has red first, too
    of_files = PIX2NVS().emulate(sorted(tmp_path.glob("*.png")), fps=30)
    assert of_files == PIX2NVS().emulate(frames, fps=30)
    (tmp_path / "2.png").write_bytes(b"?")
    with pytest.raises(FormatError, match=r"2\.png: contains no image"):
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
    with pytest.raises(FileNotFoundError, match="no camera with the number 2"):
        next(frames_of(2))


@pytest.mark.parametrize(
    ("array", "pixels"),
    [
        (np.array([[0, 7], [255, 1]], np.uint8), [[0, 7], [255, 1]]),
        (np.array([[[0], [7]]], np.uint8), [[0, 7]]),
        (np.array([[[1, 2, 3]]], np.uint8), [[[1, 2, 3]]]),
        (np.array([[[1, 2, 3, 9]]], np.uint8), [[[1, 2, 3]]]),
        (np.array([[0, 257, 514, 65_535, 300]], np.uint16), [[0, 1, 2, 255, 300 / 257]]),
        (np.array([[True, False]]), [[255, 0]]),
        (np.array([[0.0, 0.5, 1.0]], np.float32), [[0, 127.5, 255]]),
        (np.array([[[0.0, 0.5, 1.0]]]), [[[0, 127.5, 255]]]),
    ],
)
def test_what_arrays_mean(array, pixels):
    (frame,) = frames_of([array])
    assert frame.pixels.tolist() == pixels
    assert (frame.time, frame.red_first, frame.levels) == (0, True, (0, 255))
    assert frame.pixels.dtype == (np.uint8 if array.dtype in (np.uint8, bool) else np.float64)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((2, 0)), r"frame 1 has shape \(2, 0\); it must be \[H, W\], or \[H, W, 3\]"),
        (np.zeros((0, 2, 3)), r"frame 1 has shape \(0, 2, 3\)"),
        (np.zeros(5), r"frame 1 has shape \(5,\)"),
        (np.zeros((5, 5, 2)), r"frame 1 has shape \(5, 5, 2\)"),
        (np.zeros((5, 5, 5)), r"frame 1 has shape \(5, 5, 5\)"),
        (np.zeros((1, 5, 5, 3)), r"frame 1 has shape \(1, 5, 5, 3\)"),
        (np.zeros((5, 3, 1, 1)), r"frame 1 has shape \(5, 3, 1, 1\)"),
        (np.zeros((2, 2), np.int16), "frame 1 is int16; it must be uint8, uint16, bool or float"),
        (np.full((2, 2), 1.0001), r"frame 1: floats must be in \[0, 1\]"),
        (np.full((2, 2), -0.0001), r"frame 1: floats must be in \[0, 1\]"),
        (np.array([[0.5, np.nan]]), r"frame 1: floats must be in \[0, 1\]"),
    ],
)
def test_which_arrays_are_no_frames(array, message):
    found = frames_of([np.zeros((2, 2), np.uint8), array])
    next(found)
    with pytest.raises(ValueError, match=message):
        next(found)


def test_frames_without_times_come_30_a_second_and_others_when_they_say():
    plain = np.zeros((2, 3), np.uint8)
    assert [frame.time for frame in frames_of([plain] * 5)] == [0, 33_333, 66_667, 100_000, 133_333]
    assert [frame.time for frame in frames_of([plain] * 4, fps=7)] == [0, 142_857, 285_714, 428_571]
    own = [VideoFrame(500, plain, True, (16, 235)), VideoFrame(900, plain)]
    assert [frame.time for frame in frames_of(own)] == [500, 900]
    first, second = frames_of(own, times=iter([3, 8, 9]))
    assert (first.time, first.red_first, first.levels, second.time) == (3, True, (16, 235), 8)
    found = frames_of([plain] * 3, times=[0, 5])
    assert [next(found).time, next(found).time] == [0, 5]
    with pytest.raises(ValueError, match="frame 2 has no time: fewer times than frames were given"):
        next(found)


def test_frames_are_copies_of_arrays_that_are_used_again():
    def reused():
        array = np.zeros((2, 2), np.uint8)
        for n in range(3):
            array[:] = n
            yield array

    assert [int(frame.pixels[0, 0]) for frame in list(frames_of(reused()))] == [0, 1, 2]


@pytest.mark.parametrize(
    ("size", "row"),
    [
        ((4, 2), [0, 0, 100, 100]),
        ((2, 1), [0, 100]),
        ((1, 2), [50]),
        ((8, 4), [0, 0, 0, 25, 75, 100, 100, 100]),
        # where one side grows and the other shrinks, areas count
        ((2, 8), [0, 100]),
        ((8, 1), [0, 0, 0, 0, 100, 100, 100, 100]),
    ],
)
def test_how_frames_are_scaled(size, row):
    step = np.array([[0, 0, 100, 100]] * 2, np.uint8)
    for given in (step, VideoFrame(0, step)):
        (frame,) = frames_of([given], size=size)
        assert frame.pixels.shape == size[::-1]
        assert (frame.pixels == row).all()


@pytest.mark.parametrize("size", [(0, 5), (5, 0), (-1, 5), (5,), (1, 2, 3)])
def test_a_size_is_two_whole_numbers(size):
    with pytest.raises(ValueError, match=r"size must be \(width, height\) in whole pixels, not "):
        frames_of([np.zeros((2, 2))], size=size)
    assert next(frames_of([np.zeros((2, 2))], size=(1, 1))).pixels.shape == (1, 1)


@pytest.mark.parametrize(
    ("stamps", "promised", "whole"),
    [
        # ten frames of 40 ms, and three that are missing are none
        (10, 13.0, True),
        (10, 14.0, False),
        # of many, a fiftieth
        (980, 1_000.0, True),
        (979, 1_000.0, False),
        (5, 0.0, True),
    ],
)
def test_how_much_may_be_missing(tmp_path, monkeypatch, stamps, promised, whole):
    (tmp_path / "a.mkv").touch()
    monkeypatch.setattr(cv2, "VideoCapture", FakeCapture)
    monkeypatch.setattr(FakeCapture, "stamps", tuple(40.0 * n for n in range(stamps)))
    monkeypatch.setattr(FakeCapture, "promised", promised)
    if whole:
        assert len(list(frames_of(tmp_path / "a.mkv"))) == stamps
        return
    with pytest.raises(TruncatedVideo, match=f"ends after {stamps} of {int(promised)} frames: cut off or damaged"):
        list(frames_of(tmp_path / "a.mkv"))


def test_a_container_without_times_or_a_rate_has_30_frames_a_second(tmp_path, monkeypatch):
    (tmp_path / "a.mkv").touch()
    monkeypatch.setattr(cv2, "VideoCapture", FakeCapture)
    monkeypatch.setattr(FakeCapture, "stamps", (7.0,) * 4)
    monkeypatch.setattr(FakeCapture, "rate", 0.0)
    assert [frame.time for frame in frames_of(tmp_path / "a.mkv")] == [0, 33_333, 66_666, 99_999]


def test_a_container_without_a_picture(tmp_path, monkeypatch):
    (tmp_path / "a.mkv").touch()
    monkeypatch.setattr(cv2, "VideoCapture", FakeCapture)
    monkeypatch.setattr(FakeCapture, "stamps", (0.0,))
    monkeypatch.setattr(FakeCapture, "read", lambda self: (False, None))
    with pytest.raises(FormatError, match="no frame can be decoded"):
        list(frames_of(tmp_path / "a.mkv"))


def test_a_last_picture_that_stays_long_is_no_damage(tmp_path):
    """The mean rate of such a GIF promises frames until its end."""
    pictures = [Image.fromarray(np.full((40, 60), 20 * n, np.uint8)) for n in range(11)]
    times = [40] * 10 + [5_000]
    pictures[0].save(tmp_path / "a.gif", save_all=True, append_images=pictures[1:], duration=times)
    found = list(frames_of(tmp_path / "a.gif"))
    assert [frame.time for frame in found] == [40_000 * n for n in range(11)]
