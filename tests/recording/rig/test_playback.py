import time

import numpy as np
import pytest
from lab import make_video

from nvsdata.common.errors import FormatError
from nvsdata.recording.rig import playback
from nvsdata.recording.rig.monitor import Monitor
from nvsdata.recording.rig.playback import BRIGHT, DIM, perform

pytestmark = pytest.mark.usefixtures("quick")


def test_a_video_between_two_patterns(tmp_path):
    seen = []
    video = make_video(tmp_path / "a.avi", frames=6, fps=20)
    with Monitor(window=(64, 48), look=lambda time, picture: seen.append((time, picture[0, 0, 0]))) as monitor:
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


def test_pictures_that_come_too_late_are_skipped_and_counted(tmp_path):
    def slow(moment, picture):
        if picture[0, 0, 0] not in (DIM, BRIGHT):
            time.sleep(0.08)

    with Monitor(window=(80, 60), look=slow) as monitor:
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
    with Monitor(window=(64, 48), look=lambda *shown: seen.append(shown)) as monitor, pytest.raises(FormatError):
        perform(monitor, tmp_path / "a.avi")
    assert not seen
