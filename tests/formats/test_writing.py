import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import nvsdata
from nvsdata import Events, FormatError
from nvsdata import transforms as T
from nvsdata.emulation import PIX2NVS

TELLING = (".h5", ".txt", ".aedat1", ".aedat", ".aedat3", ".dat")


@pytest.mark.parametrize("suffix", TELLING)
@given(st.integers(0, 1_000), st.integers(2_000, 3_000), st.integers(0, 5))
def test_files_tell_when_a_recording_begins_and_ends(tmp_path, suffix, before, after, count):
    t = np.arange(count) * 1_000 + 5_000
    end = 5_000 + 1_000 * count + after
    ev = Events(t, t % 40, t % 30, t % 2, (128, 128), start=5_000 - before, end=end)
    # the last piece is empty, and still it is known that there were no events in its time
    pieces = [ev.window(None, 7_000), ev.window(7_000), Events.empty((128, 128), end, end)]
    nvsdata.write(iter(pieces), tmp_path / f"a{suffix}")
    recording = nvsdata.open(tmp_path / f"a{suffix}")
    assert recording.read() == ev
    assert (recording.start, recording.end) == (ev.start, ev.end)
    assert (recording.read().start, recording.read().end) == (ev.start, ev.end)
    cut = recording.read(None, 6_500)
    assert (cut.start, cut.end) == (ev.start, min(6_499, ev.end))
    cut = recording.read(6_500)
    assert (cut.start, cut.end) == (6_500, max(ev.end, 6_500))


@pytest.mark.parametrize("suffix", TELLING)
def test_a_clip_that_begins_and_ends_with_stillness_compares_as_in_memory(tmp_path, suffix):
    frames = [np.full((24, 32), 100.0) / 255] * 20
    for n in range(10):
        frame = frames[0].copy()
        frame[5:15, 2 * n : 2 * n + 8] = 0.8
        frames.append(frame)
    frames += frames[-1:] * 7
    events = PIX2NVS().emulate(frames)
    assert (events.start, events.end) == (0, 1_200_000)
    assert events.t[0] > 600_000
    assert events.t[-1] < 1_000_000
    nvsdata.write(events, tmp_path / f"a{suffix}")
    nvsdata.write(PIX2NVS().stream(frames), tmp_path / f"b{suffix}")
    for name in "ab":
        recording = nvsdata.open(tmp_path / f"{name}{suffix}", sensor_size=(32, 24))
        summed = T.ToFrames(fps=30, values="sum")(recording)
        assert summed.shape == (36, 24, 32)
        assert summed.equal(T.ToFrames(fps=30, values="sum")(events))
        real = PIX2NVS(threshold=0.3).emulate(frames)
        found, expected = (nvsdata.metrics.compare(e, real).chamfer.frames for e in (recording, events))
        assert np.array_equal(found, expected, equal_nan=True)


@pytest.mark.parametrize("suffix", [".h5", ".txt", ".npy", ".dat", ".aedat3"])
def test_times_that_no_reader_takes_are_not_written(tmp_path, suffix):
    for time in (2**62, -(2**62)):
        columns = Events([0], [1], [1], [1], (5, 5)).columns._replace(t=np.array([time]))
        with pytest.raises(ValueError, match=r"2\^62"):
            nvsdata.write(Events.trusted(columns, (5, 5)), tmp_path / f"a{suffix}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".txt", ".aedat", ".dat", ".aedat3"])
def test_a_time_that_does_not_hold_the_events_is_refused(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    nvsdata.write(Events([10, 99], [1, 1], [1, 1], [1, 1], (5, 5)), path)
    head, _, body = path.read_bytes().partition(b"99 us")
    path.write_bytes(head + b"98 us" + body)
    with pytest.raises(FormatError, match="events at 10 to 99 µs, outside the time that it states: 10 to 98 µs"):
        nvsdata.read(path)
    recording = nvsdata.open(path, strict=False)
    assert recording.read().end == 99
    assert recording.repairs


def test_windows_may_count_from_the_first_event(tmp_path):
    ev = Events([10**9, 10**9 + 20_000, 10**9 + 40_000], [1, 1, 1], [1, 1, 1], [1, 1, 1], (5, 5))
    nvsdata.write(ev, tmp_path / "a.h5")
    assert nvsdata.read(tmp_path / "a.h5", 0, 30_000, relative=True) == ev[:2]
    assert nvsdata.read(tmp_path / "a.h5", 30_000, relative=True) == ev[2:]
    with pytest.warns(UserWarning, match=r"\[0, 30000\) has no events; the file's are at 1000000000 to 1000040000 µs"):
        assert len(nvsdata.read(tmp_path / "a.h5", 0, 30_000)) == 0


def test_home_folders(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    nvsdata.write(Events([1], [1], [1], [1]), "~/a.h5")
    assert len(nvsdata.read("~/a.h5")) == 1
    assert (tmp_path / "a.h5").exists()


@pytest.mark.skipif(os.name != "posix", reason="pipes as POSIX has them")
@pytest.mark.parametrize("name", ["a.h5", "a.bin", "a"])
def test_a_pipe_is_not_waited_for(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(FormatError, match="is a pipe or a device, not a recording"):
        nvsdata.open(tmp_path / name)


@pytest.mark.parametrize("suffix", [".h5", ".npy", ".txt"])
def test_a_window_without_a_beginning_has_the_events_before_0(tmp_path, suffix):
    ev = Events([-500, -3, 7], [1, 2, 3], [1, 1, 1], [1, 0, 1], (5, 5))
    nvsdata.write(ev, tmp_path / f"a{suffix}")
    recording = nvsdata.open(tmp_path / f"a{suffix}", sensor_size=(5, 5))
    assert recording.read(None, 0) == ev.window(None, 0) == ev[:2]
    assert recording.read(-400) == ev[1:]
