"""FFmpeg's own complaints about a stream, counted."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import cv2
import numpy as np
import pytest
from clips import moving_square

from nvsdata.video import decoder_errors as module
from nvsdata.video.decoder_errors import DecoderErrors, decoder_errors
from nvsdata.video.frames import frames_of

pytestmark = pytest.mark.skipif(module._counter() is None, reason="this OpenCV has no library of FFmpeg to ask")
FRAMES = 24


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A video of pictures that are told as changes of those before."""
    path = tmp_path_factory.mktemp("clip") / "a.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25, (64, 48))
    for frame in moving_square(FRAMES):
        writer.write(frame)
    writer.release()
    return path


@pytest.fixture
def damaged(clip, tmp_path):
    """The same with ten bytes in the middle of its stream overwritten; as many frames come out of it."""
    content = bytearray(clip.read_bytes())
    stream = content.index(b"mdat")
    start = stream + int.from_bytes(content[stream - 4 : stream], "big") // 2
    content[start : start + 10] = np.random.default_rng(0).integers(0, 256, 10, np.uint8).tobytes()
    path = tmp_path / "damaged.mp4"
    path.write_bytes(content)
    return path


def errors(path):
    before = decoder_errors()
    assert sum(1 for _ in frames_of(path)) == FRAMES
    return decoder_errors() - before


def test_a_whole_stream_has_none_and_a_damaged_one_some(clip, damaged):
    assert errors(clip) == 0
    found = errors(damaged)
    assert found > 0
    assert errors(damaged) == found
    assert errors(clip) == 0


def test_threads_that_decode_at_once_lose_no_error(damaged):
    one, before = errors(damaged), decoder_errors()
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda _: list(frames_of(damaged)), range(12)))
    assert decoder_errors() - before == 12 * one


def test_errors_of_videos_that_are_decoded_at_once_are_nobodys(clip, damaged):
    def counted(path, both):
        with DecoderErrors() as found:
            both.wait(60)
            list(frames_of(path))
            both.wait(60)
        return found.found

    with ThreadPoolExecutor(2) as threads:
        both = Barrier(2)
        assert list(threads.map(counted, (clip, damaged), (both, both))) == [0, 0]
    with DecoderErrors() as after:
        list(frames_of(damaged))
    assert after.found == errors(damaged)


def test_a_process_that_still_decodes_ends_well(damaged):
    code = f"""
from nvsdata.video.decoder_errors import DecoderErrors, decoder_errors
from nvsdata.video.frames import frames_of
decoder_errors()
frames = frames_of({str(damaged)!r})
next(frames)
print(decoder_errors() > 0 or sum(1 for _ in frames) and decoder_errors() > 0)
left = frames_of({str(damaged)!r})
next(left)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stdout, done.stderr) == (0, "True\n", "")


def test_users_who_want_ffmpegs_lines_see_them(monkeypatch):
    monkeypatch.setenv("OPENCV_FFMPEG_LOGLEVEL", "16")
    assert module._counter.__wrapped__() is None


def test_without_the_library_there_is_nothing_to_count(monkeypatch):
    monkeypatch.setattr(module, "LIBRARIES", ("none*",))
    assert module._counter.__wrapped__() is None
    monkeypatch.setattr(module, "_counter", lambda: None)
    assert decoder_errors() == 0
