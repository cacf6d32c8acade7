"""Matching of events and triggers of a take with the flashes that were shown."""

import numpy as np
import pytest

import nvsdata
from nvsdata import Events
from nvsdata.recording.capture import RecordingReport
from nvsdata.rig import sync
from nvsdata.rig.clock_fit import NoSync, flashes
from nvsdata.rig.playback import PlaybackLog
from nvsdata.rig.sync import ScreenRecording, around_flashes, synced

STEP, START, STOP = 50_000.0, 4_000_000.0, 9_000_000.0  # µs, of the host
DELAY = 4_000  # µs from a change of the screen to its events


def events_at(t, p=None):
    t = np.asarray(t)
    return Events(t, t * 0, t * 0, np.ones_like(t) if p is None else p, (40, 30))


def test_only_the_events_around_the_flashes_are_looked_at(tmp_path):
    zero, start = 100_000.0, 3_000_000.0
    t = [499_000, 501_000, 1_500_000, 2_600_000, 2_604_000, 5_490_000, 5_498_000, 6_000_000, 6_600_000, 6_604_000]
    nvsdata.write(events_at(t), tmp_path / "a.h5")
    done = PlaybackLog(16_667.0, flashes=[1_100_000.0, 2_200_000.0, start + 3_100_000, start + 3_200_000], start=start)
    found = around_flashes(ScreenRecording(tmp_path / "a.h5", RecordingReport(None, zero=zero), done))
    # from half a second before the first to half a second after the last, and a drift of 500 ppm more
    # 1,000,000 - 500 - 500,000 to 2,100,000 + 1,050 + 500,000; 6,000,000 - 3,000 - 500,000 to 6,603,050
    assert found.t.tolist() == [501_000, 1_500_000, 2_600_000, 5_498_000, 6_000_000, 6_600_000]
    assert found.sensor_size == (40, 30)
    close = PlaybackLog(16_667.0, flashes=[600_000.0, 1_700_000.0, start + 1, start + 2], start=start)
    # what lies around both groups is read once, and nothing from before the recording
    found = around_flashes(ScreenRecording(tmp_path / "a.h5", RecordingReport(None, zero=zero + 2.6e6), close))
    assert found.t.tolist() == [499_000, 501_000]


def pattern(began):
    """Host times of the pattern's changes, and whether they are to bright."""
    bits = np.array([0, *flashes(), 0])
    changes = np.flatnonzero(np.diff(bits.astype(int)))
    return began + changes * STEP, bits[changes + 1] == 1


@pytest.fixture
def taken(tmp_path):
    """A take whose events show the flashes `DELAY` later, and the triggers that are given."""
    rng = np.random.default_rng(0)
    (first, rising), (second, _) = pattern(1_000_000.0), pattern(10_000_000.0)
    host, bright = np.concatenate((first, second)), np.concatenate((rising, rising))
    bursts = [np.sort(rng.integers(0, 8_000, 400)) + round(time) + DELAY for time in host]
    t = np.concatenate(bursts)
    p = np.repeat(bright, 400)

    def take(triggers, t=t, p=p):
        order = np.argsort(t, kind="stable")
        nvsdata.write(events_at(t[order], p[order].astype(int)), tmp_path / "raw.h5")
        done = PlaybackLog(16_667.0, host.tolist(), bright.tolist(), START, STOP)
        return ScreenRecording(tmp_path / "raw.h5", RecordingReport(None, triggers=sorted(map(int, triggers))), done)

    take.rising = host[bright]
    return take


def test_a_photodiode_that_sees_flashes_alone_is_believed(taken):
    # the video flickers, too, which is nothing to the flashes
    found = synced(taken([*taken.rising + 1_000, *np.arange(START, STOP, 40_000)]))
    assert (found.by, found.refused) == ("triggers", None)
    assert found.line.camera(START) == pytest.approx(START + 1_000, abs=50)


def test_without_triggers_events_are_what_counts(taken):
    found = synced(taken([]))
    assert (found.by, found.refused) == ("events", None)
    assert found.line.camera(START) == pytest.approx(START + DELAY + 400, abs=300)


@pytest.mark.parametrize("hertz", [20, 60, 100, 240, 1_000])
def test_foreign_pulses_are_refused_and_events_taken(taken, hertz):
    foreign = np.arange(0, 12_000_000, 1e6 / hertz)
    for triggers in (foreign, np.concatenate((foreign, taken.rising + 1_000))):
        found = synced(taken(triggers))
        assert found.by == "events"
        assert "something else triggers, too" in found.refused
        assert found.line.camera(START) == pytest.approx(START + DELAY + 400, abs=300)


def test_a_photodiode_that_fires_at_the_dim_level_of_a_dimmed_screen(taken):
    # from the dim picture on, 300 ms before the first flash, at the lamp's 240 Hz: in step with the host
    dim = np.concatenate([np.arange(began - 300_000, began + 1_600_000, 1e6 / 240) for began in (1e6, 1e7)])
    found = synced(taken(dim))
    assert found.by == "events"
    assert "triggers among" in found.refused


def test_few_foreign_pulses_are_no_flashes(taken):
    found = synced(taken([500_000, 5_000_000, 11_000_000]))
    assert found.by == "events"
    assert "can't be matched" in found.refused or "the camera saw" in found.refused


@pytest.mark.parametrize(("late", "by"), [(-900, "triggers"), (8_900, "triggers"), (30_000, None), (-298_000, None)])
def test_triggers_that_disagree_with_events_are_told(taken, late, by):
    """A diode that sees all flashes, but at other times, is wired to something else: nobody knows which is right."""
    take = taken(taken.rising + late + 400)
    if by:
        assert synced(take).by == by
    else:
        with pytest.raises(NoSync, match=r"in the events and in the triggers are \d+\.\d ms apart"):
            synced(take)


def test_triggers_alone_show_no_picture(taken):
    with pytest.raises(NoSync):
        synced(taken(taken.rising, t=np.arange(0, 12_000_000, 2_000), p=np.arange(6_000) % 2))
    assert sync.APART == 5_000
