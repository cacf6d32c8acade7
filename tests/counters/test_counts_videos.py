"""Frames that are decoded: each once, and none again for what is there already."""

import os
from collections import Counter

import cv2
import pytest
from clips import moving_square, write_video

import nvsdata
from nvsdata.cli import main
from nvsdata.commands import tune
from nvsdata.common.prefetch import DEPTH
from nvsdata.emulation import PIX2NVS
from nvsdata.emulation.convert import convert_videos
from nvsdata.emulation.tuning.objective import TuningPair
from nvsdata.video.frames import frames_of

LENGTH = 12


@pytest.fixture
def decoded(monkeypatch):
    """Counts files that OpenCV opens, and frames that it decodes."""
    tally, capture = Counter(), cv2.VideoCapture

    class Counting:
        def __init__(self, *args):
            tally["files"] += 1
            self._inner = capture(*args)

        def __getattr__(self, name):
            return getattr(self._inner, name)

        def read(self):
            found, frame = self._inner.read()
            tally["frames"] += found
            return found, frame

    monkeypatch.setattr(cv2, "VideoCapture", Counting)
    return tally


@pytest.fixture
def video(tmp_path):
    return write_video(tmp_path / "v.avi", moving_square(LENGTH))


@pytest.mark.parametrize("color", [False, True])
def test_each_frame_of_a_file_is_decoded_once(decoded, video, color):
    assert len(list(frames_of(video, color=color))) == LENGTH
    # the first one by a second reader, too: whether it has luma alone
    assert decoded["frames"] == LENGTH + (not color)
    assert decoded["files"] == 1 + (not color)


def test_an_emulation_decodes_each_frame_once(decoded, video):
    assert len(PIX2NVS().emulate(video))
    assert decoded["frames"] == LENGTH + 1


def test_frames_beyond_what_is_asked_for_are_hardly_decoded(decoded, tmp_path):
    stream = PIX2NVS().stream(write_video(tmp_path / "long.avi", moving_square(200)))
    for _ in range(3):
        next(stream)
    stream.close()
    # threads decode ahead
    assert decoded["frames"] < 100


def test_a_folder_that_is_converted_already_decodes_nothing(decoded, tmp_path, monkeypatch):
    for name in ("a", "b", "c"):
        write_video(tmp_path / f"in/{name}.avi", moving_square(LENGTH))
    assert convert_videos(tmp_path / "in", tmp_path / "out").done == 3
    assert decoded["frames"] == 3 * (LENGTH + 1)
    decoded.clear()
    written = {path: os.stat(path).st_mtime_ns for path in (tmp_path / "out").iterdir()}
    assert convert_videos(tmp_path / "in", tmp_path / "out").kept == 3
    assert not decoded
    assert {path: os.stat(path).st_mtime_ns for path in (tmp_path / "out").iterdir()} == written
    # one more file costs what it takes by itself
    write_video(tmp_path / "in/d.avi", moving_square(LENGTH))
    assert convert_videos(tmp_path / "in", tmp_path / "out").done == 1
    assert decoded["frames"] == LENGTH + 1


def test_a_pair_decodes_its_video_once_however_many_settings_are_measured(decoded, video):
    pair = TuningPair(PIX2NVS(threshold=0.3).emulate(video), video)
    decoded.clear()
    for threshold in (0.2, 0.3, 0.4):
        pair(PIX2NVS(threshold=threshold))
    assert not decoded


def test_tuning_again_measures_nothing(decoded, video, tmp_path, monkeypatch, capsys):
    nvsdata.write(PIX2NVS(threshold=0.3).emulate(video), tmp_path / "real.h5")
    monkeypatch.chdir(tmp_path)
    emulated, emulate = [], TuningPair.emulate
    monkeypatch.setattr(TuningPair, "emulate", lambda *args: emulated.append(1) or emulate(*args))
    monkeypatch.setattr(tune.plots, "save_png", lambda *_, **__: None)
    words = "tune --real real.h5 --video v.avi --trials 5".split()
    # those tried; the best one for its picture, and with those as given on what the search doesn't see
    for count in (5 + 1 + 2, 1 + 2):
        emulated.clear()
        decoded.clear()
        assert main(words) == 0
        assert len(emulated) == count
        # colors if hue is tried; and whether the first frame has any, while those after it are read ahead
        assert decoded["frames"] <= 2 * LENGTH + 1 + DEPTH + 1
