"""Counts of a take, and the limits for its faults."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

import nvsdata
from nvsdata import Events
from nvsdata.batch.folder import Video
from nvsdata.batch.manifest import sha256
from nvsdata.recording.capture import RecordingReport
from nvsdata.rig import take
from nvsdata.rig.clock_fit import ClockFit
from nvsdata.rig.playback import PlaybackLog, _in_turn
from nvsdata.rig.sync import ScreenRecording, Sync
from nvsdata.rig.take import TakeRejected, Tally, _check, _check_stream, _log, _tally, trim


def events_at(t, p=None):
    t = np.asarray(t)
    return Events(t, t * 0, t * 0, np.ones_like(t) if p is None else p, (40, 30))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({}, None),
        # 2% of 2.5 s, and what a refresh or 20 ms explain isn't wrong
        ({"late": 100, "by": 20_000}, None),
        ({"late": 5, "by": 30_000}, None),
        ({"late": 5, "by": 30_010}, r"showed a wrong frame for 50 ms \(5 of 100 frames were late or left out\)"),
        ({"skipped": 50_000.0}, None),
        ({"late": 2, "by": 25_000, "skipped": 41_000.0}, r"51 ms \(3 of 101 frames"),
        ({"residual": 1_000.0}, None),
        ({"residual": 1_001.0}, "the median distance of the flashes from the fit is 1001 µs"),
        ({"late_resets": 1}, "the camera's clock was reset during the recording"),
        ({"usb_errors": 1}, "USB transfers failed"),
        ({"full": 0.01}, None),
        ({"full": 0.011}, "the readout is full for 1% of the time: lower the contrast"),
        ({"lost": 1}, "1 bytes came faster than they could be decoded and written"),
        ({"dropped": 1}, "the camera dropped 1 events"),
        ({"dropped": None}, None),
        ({"dropped": 28_000, "within": 0}, None),
        ({"dropped": 28_000, "within": 3}, "the camera dropped 3 events"),
        ({"lost_wraps": 1}, "parts of the camera's stream are missing"),
    ],
)
def test_how_much_may_be_amiss(changed, message):
    given = {"late": 0, "by": 0, "skipped": None, "residual": 5.0, "events": 5_000, "full": 0.0} | changed
    report = RecordingReport(None, lost=given.get("lost", 0), dropped=given.get("dropped", 0))
    faults = ("lost_wraps", "late_resets", "usb_errors")
    report.error_counts = {"odd_bytes": 3} | {name: given.get(name, 0) for name in faults}
    done = PlaybackLog(16_667.0, dropped=given.get("within"))
    for n in range(100):
        done.add(n * 40_000.0, n * 40_000.0 + (given["by"] if n < given["late"] else 16_667))
    if given["skipped"] is not None:
        done.skip(given["skipped"])
    line = ClockFit(0.0, 0.0, given["residual"], 30, 32)
    with nullcontext() if message is None else pytest.raises(TakeRejected, match=message):
        _check_stream(report, done)
        _check(done, line, Tally(given["events"], 0, given["full"]), 2_500_000)


def test_what_is_counted_of_a_recording(tmp_path, monkeypatch):
    """Full bins are those of 10 ms with more than 10 events per µs; here the limit is 3 events a bin."""
    monkeypatch.setattr(take, "FULL", 3 * 100)
    monkeypatch.setattr(take, "PIECE", 40_000)
    t = [4_999, 5_000, 5_001, 5_002, 14_999, 15_000, 15_001, 15_002, 45_000, 54_999, 54_999, 54_999, 55_000, 99_999]
    p = np.array([1, 0, 1, 1, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1])
    nvsdata.write(events_at(t, p), tmp_path / "a.h5")
    recording = nvsdata.open(tmp_path / "a.h5")
    tally = _tally(recording, 5_000, 99_999)
    # [5,000, 15,000) has 4 events and [45,000, 55,000) has 4; three in a bin aren't full
    assert (tally.events, tally.on) == (12, 5)
    assert tally.full == pytest.approx(2 * 10_000 / 94_999)
    assert _tally(recording, 200_000, 200_000) == Tally(0, 0, 0.0)
    assert _tally(recording, 15_000, 45_000) == Tally(3, 0, 0.0)


def test_a_take_is_cut_to_its_video(tmp_path, monkeypatch):
    line = ClockFit(1_000.4, 0.5, 10.0, 9, 9)
    monkeypatch.setattr(take, "synced", lambda one: Sync(line, "events", "stray"))
    t = [2_499, 2_500, 3_000, 31_000, 31_001]
    nvsdata.write(events_at(t, np.array([1, 1, 0, 1, 1])), tmp_path / "raw.h5")
    report = RecordingReport(None, dropped=7, error_counts={"a": 2, "b": 0}, temperature=20.5)
    done = PlaybackLog(16_667.0, start=1_000.0, stop=20_000.0, frames=2, dropped=0)
    one, video = ScreenRecording(tmp_path / "raw.h5", report, done), tmp_path / "a.avi"

    def judged(span, given, events):
        assert (span.take, span.line, span.start, span.stop) == (one, line, 2_500, 31_000)
        assert (given, events) == (video, 2)
        return {"content": {"gap": 0.0}, "review": ["odd"]}

    result = trim(one, Video("a.avi", video, tmp_path / "deep/out/a.h5"), SimpleNamespace(judged=judged))
    assert nvsdata.read(tmp_path / "deep/out/a.h5").t.tolist() == [0, 500]
    assert result == {
        "recording": (tmp_path / "deep/out/a.h5").stat().st_size,
        "recording_sha256": sha256(tmp_path / "deep/out/a.h5"),
        "duration": 28_500,
        "events": 2,
        "on": 1,
        "sensor_size": (40, 30),
        "sync": {"by": "events", "offset": 1_000.4, "drift": 0.5, "residual": 10.0, "used": 9, "flashes": 9}
        | {"triggers": "stray"},
        "frames": 2,
        "late": 0,
        "skipped": 0,
        "wrong": 0.0,
        "dropped": 0,
        "dropped_in_all": 7,
        "errors": {"a": 2},
        "temperature": 20.5,
        "content": {"gap": 0.0},
        "review": ["odd"],
    }


@pytest.mark.parametrize(("now", "skipped"), [(91_666.0, 0), (91_667.0, 1)])
def test_a_picture_is_skipped_if_the_next_is_due(monkeypatch, now, skipped):
    """From half a refresh before that on."""
    monkeypatch.setattr("nvsdata.rig.playback.host_time", lambda: now)
    shown = []
    monitor = SimpleNamespace(refresh=16_667.0, show=lambda frame, due: shown.append(due) or due + 5)
    done = PlaybackLog(16_667.0, start=20_000.0)
    _in_turn(monitor, done, SimpleNamespace(time=40_000), 100_000.0)
    assert (done.frames, done.skipped, done.wrong) == ((1, 1, 40.0) if skipped else (1, 0, 0.0))
    assert (shown, done.due, done.shown) == (([], [], []) if skipped else ([60_000.0], [60_000.0], [60_005.0]))


def test_what_was_played_in_whole_microseconds():
    done = PlaybackLog(16_666.67, [900.4, 1_200.0], [True, False], 1_000.0, 2_000.6)
    done.add(1_000.0, 1_001.0)
    done.add(1_500.0, 20_000.0)
    for _ in range(3):
        done.skip(0.0)
    assert _log(done) == {
        "refresh": 16_666.7,
        "late": 1,
        "skipped": 3,
        "wrong": 0.0,
        "flashes": [-100, 200],
        "due": [0, 500],
        "shown": [1, 19_000],
        "stop": 1_001,
        "bright": [1, 0],
    }
    assert done.frames == 5
