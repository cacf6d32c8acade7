"""A video in parts gives the events of all of it at once, whatever process goes on."""

import pickle

import numpy as np
import pytest
from clips import moving_square, write_video

from nvsdata.data.events import concatenate_events
from nvsdata.emulation import DVS, PIX2NVS, StatefulEmulator

SETTINGS = [
    PIX2NVS(),
    PIX2NVS(timestamps="random", noise_rate=20.0, hot_pixels=0.01, refractory=2_000, mismatch=0.1, seed=3),
    PIX2NVS(exp=True, mode="LICE"),
    DVS(noise_rate=10.0, cutoff=100.0, leak=0.5),
    DVS(upsample=3),
    DVS(upsample="linear", bandwidth=2e5),
]


@pytest.mark.parametrize("settings", SETTINGS, ids=range(len(SETTINGS)))
@pytest.mark.parametrize("cuts", [(5,), (1, 2, 9), ()])
def test_parts_are_the_whole(settings, cuts):
    frames = moving_square(14)
    whole = settings.emulate(frames, fps=25)
    going, parts = StatefulEmulator(settings), []
    for start, stop in zip((0, *cuts), (*cuts, 14), strict=True):
        parts.append(going.feed(frames[start:stop], fps=25))
        # another process goes on
        going = pickle.loads(pickle.dumps(going))
    assert concatenate_events(parts) == whole
    assert len(whole) > 100
    assert parts[-1].end == whole.end


def test_times_of_ones_own(tmp_path):
    frames, times = moving_square(6), [0, 10_000, 50_000, 60_000, 61_000, 90_000]
    going = StatefulEmulator(PIX2NVS())
    parts = [going.feed(frames[:4], times=times[:4]), going.feed(frames[4:], times=times[4:])]
    expected = list(PIX2NVS().stream(frames, times=times))
    assert concatenate_events(parts) == concatenate_events(expected)
    with pytest.raises(ValueError, match="times must rise"):
        going.feed(frames[:1], times=[90_000])


def test_files_follow_each_other(tmp_path):
    """The second begins a frame's time after the first has ended."""
    frames = moving_square(12)
    for name, part in (("a", frames[:6]), ("b", frames[6:]), ("all", frames)):
        write_video(tmp_path / f"{name}.avi", part, fps=20)
    going = StatefulEmulator(PIX2NVS())
    parts = [going.feed(tmp_path / "a.avi"), going.feed(tmp_path / "b.avi")]
    assert (parts[0].end, parts[1].start, parts[1].end) == (250_000, 250_000, 550_000)
    whole = PIX2NVS().emulate(tmp_path / "all.avi")
    # JPEG codes each picture alone, so they are the same
    assert np.array_equal(concatenate_events(parts).t, whole.t)


def test_calls_without_frames():
    going = StatefulEmulator(PIX2NVS())
    with pytest.raises(ValueError, match="the video has no frames"):
        going.feed([])
    frames = moving_square(3)
    assert len(going.feed(frames[:1])) == 0
    assert len(going.feed([])) == 0
    assert len(going.feed(frames[1:])) > 0


def test_after_an_error_the_state_is_that_before_the_call():
    frames = moving_square(8)

    def broken():
        yield from frames[2:5]
        raise OSError("the disk is gone")

    going = StatefulEmulator(PIX2NVS(noise_rate=10.0))
    first = going.feed(frames[:2], fps=25)
    with pytest.raises(OSError, match="the disk is gone"):
        going.feed(broken(), fps=25)
    assert concatenate_events([first, going.feed(frames[2:], fps=25)]) == PIX2NVS(noise_rate=10.0).emulate(
        frames, fps=25
    )
