import time
from contextlib import nullcontext

import numpy as np
import pytest
from lab import make_video

from nvsdata.common.errors import FormatError
from nvsdata.recording.camera import host_time
from nvsdata.rig import playback
from nvsdata.rig.monitor import Monitor
from nvsdata.rig.playback import BRIGHT, DIM, perform
from nvsdata.video.frames import VideoFrame

pytestmark = pytest.mark.usefixtures("quick")


def test_a_video_between_two_patterns(tmp_path):
    seen = []
    video = make_video(tmp_path / "a.avi", frames=6, fps=20)
    with Monitor(window=(64, 48), on_change=lambda time, picture: seen.append((time, picture[0, 0, 0]))) as monitor:
        done = perform(monitor, video)
    changes = np.count_nonzero(np.diff(np.concatenate(([0], playback.flashes().astype(int), [0]))))
    assert len(done.flashes) == len(done.bright) == 2 * changes
    assert done.bright[:changes] == done.bright[changes:]
    levels = dict(seen)
    assert [levels[time] for time in done.flashes] == [BRIGHT if bright else DIM for bright in done.bright]
    assert done.flashes[changes - 1] < done.start < done.stop < done.flashes[changes]
    assert done.frames == 6
    assert np.allclose(np.diff(done.due), 50_000, atol=1) or done.skipped
    assert done.stop - done.start == pytest.approx(300_000, abs=2)
    assert done.truncated is None


def test_every_picture_is_shown_when_it_is_due(tmp_path, clock):
    """Each is on the screen within half a refresh of its time in the video, for as long as it lasts there."""
    seen = []
    # what is shown says which picture it is
    video = make_video(tmp_path / "a.avi", frames=20, fps=12.5)
    with Monitor(window=(80, 60), on_change=lambda time, picture: seen.append((time, picture.copy()))) as monitor:
        done = perform(monitor, video)
        refresh = monitor.refresh
    shown = dict(seen)
    assert (done.late, done.skipped, done.frames) == (0, 0, 20)
    due = done.start + np.arange(20) * 80_000
    assert np.allclose(done.due, due, atol=1)
    assert abs(np.array(done.shown) - due).max() < refresh / 2 + 100
    # the disc moves on by 4 pixels a picture; the first was shown before
    for n in range(1, 20):
        red = np.argwhere((shown[done.shown[n]][..., 0] > 150) & (shown[done.shown[n]][..., 2] < 90))
        assert red[:, 1].mean() == pytest.approx(10 + 4 * n, abs=3) or 10 + 4 * n > 68
    # flashes: each step lasts so many refreshes, and the last one is over before the video begins, or after its end
    steps = np.diff(done.flashes[: len(done.flashes) // 2]) / refresh / playback.STEP
    assert abs(steps - np.rint(steps)).max() < 0.01
    assert done.start - max(time for time in done.flashes if time < done.start) > playback.SETTLE
    assert min(time for time in done.flashes if time > done.start) - done.stop > playback.STILL


def test_pictures_that_come_too_late_are_skipped_and_counted(tmp_path):
    def slow(moment, picture):
        if picture[0, 0, 0] not in (DIM, BRIGHT):
            time.sleep(0.08)

    with Monitor(window=(80, 60), on_change=slow) as monitor:
        done = perform(monitor, make_video(tmp_path / "a.avi", frames=10, fps=25))
    assert done.skipped > 0
    assert done.frames == 10


def test_a_video_that_is_cut_off_is_shown_as_far_as_it_goes(tmp_path):
    video = make_video(tmp_path / "a.avi", frames=30)
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    with Monitor(window=(64, 48)) as monitor:
        done = perform(monitor, video)
    assert "cut off or damaged" in done.truncated
    assert 5 < done.frames < 30


def test_what_is_no_video_is_told_before_anything_is_shown(tmp_path):
    (tmp_path / "a.avi").write_bytes(b"RIFF....")
    seen = []
    with Monitor(window=(64, 48), on_change=lambda *shown: seen.append(shown)) as monitor, pytest.raises(FormatError):
        perform(monitor, tmp_path / "a.avi")
    assert not seen


def test_nothing_jumps_between_the_dim_level_and_the_picture(tmp_path, monkeypatch):
    """A jump from dim to a white or black picture would overrun the sensor's memory."""
    monkeypatch.setattr(playback, "FADE", 400_000)
    seen = []
    white = np.full((60, 80), 255, np.uint8)
    frames = [VideoFrame(0, white), VideoFrame(40_000, white)]
    monkeypatch.setattr(playback, "frames_of", lambda video: iter(frames))
    with Monitor(window=(100, 60), on_change=lambda moment, picture: seen.append((moment, picture.copy()))) as monitor:
        done = perform(monitor, tmp_path / "white")
    picture = [shown for moment, shown in seen if moment not in done.flashes]
    middle = np.array([int(shown[30, 50, 0]) for shown in picture])
    beside = np.array([int(shown[30, 5, 0]) for shown in picture])
    # 12 steps at least, from gray to white in the middle, and to black beside it
    up = middle[: int(np.argmax(middle == 255)) + 1]
    assert np.diff(up[up >= DIM]).max() <= 16
    assert np.abs(np.diff(beside)).max() <= 12
    assert (beside.min(), middle.max()) == (0, 255)
    # and back again before the pattern
    back = middle[len(middle) - int(np.argmax(middle[::-1] == 255)) - 1 :]
    assert back.size > 10
    assert np.abs(np.diff(back)).max() <= 16
    assert done.start - done.flashes[len(done.flashes) // 2 - 1] > playback.SETTLE + playback.FADE


def test_only_what_is_dropped_while_the_video_plays_counts(tmp_path):
    counts = iter([17_000, 17_003])
    video = make_video(tmp_path / "a.avi", frames=3)
    with Monitor(window=(64, 48)) as monitor:
        assert perform(monitor, video, lambda: next(counts)).dropped == 3
        # a camera that doesn't count
        assert perform(monitor, video).dropped is None


def test_the_drops_are_counted_close_to_the_video(tmp_path):
    asked = []
    video = make_video(tmp_path / "a.avi", frames=6)
    with Monitor(window=(64, 48)) as monitor:
        done = perform(monitor, video, lambda: asked.append(host_time()) or 0)
    before, after = asked
    assert 0 < done.start - before < playback.COUNTED + 50_000
    assert 0 <= after - done.stop < 50_000
    # the first picture has been there for as long as it should before the video moves
    assert done.shown[0] == done.start


def test_a_video_that_is_too_fast_for_the_screen_is_told_before_anything_is_shown(tmp_path):
    fast, seen = make_video(tmp_path / "fast.avi", frames=24, fps=120), []
    message = "the video has 120 frames per second, but the screen shows 60"
    refused = pytest.raises(ValueError, match=message)
    with Monitor(window=(64, 48), on_change=lambda *shown: seen.append(shown)) as monitor, refused:
        perform(monitor, fast)
    assert not seen
    # as fast as the screen is fast enough
    with Monitor(window=(64, 48)) as monitor:
        assert perform(monitor, make_video(tmp_path / "a.avi", frames=14, fps=60)).frames == 14


@pytest.mark.parametrize(
    ("fps", "refresh", "message"), [(60, 59.94, False), (60, 60, False), (61, 60, True), (66, 60, True)]
)
def test_a_video_slightly_faster_than_the_screen_is_told_as_such(fps, refresh, message):
    """Not as a computer that is busy, after three takes."""
    frames = [VideoFrame(round(n * 1e6 / fps), np.zeros((2, 2), np.uint8), True) for n in range(playback.LOOKED_AT)]
    with pytest.raises(ValueError, match=f"the video has {fps} frames per second") if message else nullcontext():
        playback._check_rate(frames, 1e6 / refresh)
