"""FFmpeg's own complaints about a stream, counted."""

import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest
from clips import damage, moving_square, write_stream

from nvsdata.video import decoder_errors as module
from nvsdata.video.decoder_errors import DecoderErrors, decoder_errors
from nvsdata.video.frames import frames_of

pytestmark = pytest.mark.skipif(not module._counts(), reason="this OpenCV has no library of FFmpeg to ask")
FRAMES = 24


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return write_stream(tmp_path_factory.mktemp("clip") / "a.mp4", moving_square(FRAMES))


@pytest.fixture
def damaged(clip, tmp_path):
    path = Path(shutil.copy(clip, tmp_path / "damaged.mp4"))
    damage(path)
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
    assert not module._counts.__wrapped__()


def test_without_the_library_there_is_nothing_to_count(monkeypatch):
    monkeypatch.setattr(module, "LIBRARIES", ("none*",))
    assert not module._counts.__wrapped__()
    monkeypatch.setattr(module, "_counts", lambda: False)
    assert decoder_errors() == 0
