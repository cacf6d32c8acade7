"""Flashes found again in what a camera saw of them."""

import numpy as np
import pytest

from nvsdata import Events
from nvsdata.rig.clock_fit import ONSET, ClockFit, NoSync, fit_clock, flashes

FRAME = 1e6 / 60


def shown(start, steps=31, hold=3):
    """Host times and directions of the changes of a pattern from `start` on, each step so many frames long."""
    levels = np.concatenate(([0], flashes(steps), [0])).astype(int)
    changes = np.flatnonzero(np.diff(levels))
    return start + changes * hold * FRAME, levels[changes + 1] == 1


def seen(times, bright, seed=0, video=(0, 0), noise=20_000, delay=(800, 1_500), spread=700):
    """Events of flashes at camera `times`, of a video between, and noise."""
    rng = np.random.default_rng(seed)
    t, p = [], []
    for at, up in zip(times, bright, strict=True):
        count = rng.integers(2_000, 6_000)
        t.append(at + delay[0 if up else 1] + rng.exponential(spread, count))
        p.append(np.full(count, up))
    span = (min(times) - 5e5, max(times) + 5e5)
    for count, (a, b) in (
        (int(noise * (span[1] - span[0]) / 1e6), span),
        (int(3e5 * (video[1] - video[0]) / 1e6), video),
    ):
        t.append(rng.uniform(a, b, count))
        p.append(rng.integers(0, 2, count))
    t, p = np.concatenate(t), np.concatenate(p).astype(int)
    order = np.argsort(t)
    n = t.size
    return Events(t[order].astype(np.int64), rng.integers(0, 240, n), rng.integers(0, 180, n), p[order], (240, 180))


@pytest.mark.parametrize("seed", range(4))
def test_drift_and_offset_with_late_flashes_noise_and_a_video_between(seed):
    rng = np.random.default_rng(seed)
    drift, offset = rng.uniform(-100e-6, 100e-6), rng.uniform(1e6, 4e6)
    before, up = shown(2e6)
    after, down = shown(14e6)
    host, bright = np.concatenate((before, after)), np.concatenate((up, down))
    # the screen was late by a frame three times, unknown to the host, and each flash by a little
    late = np.zeros(host.size)
    late[rng.choice(host.size, 3, replace=False)] = FRAME
    camera = offset + (1 + drift) * (host + late) + rng.normal(0, 50, host.size)
    found = fit_clock(seen(camera, bright, seed, video=(offset + 4e6, offset + 13e6)), host, bright)
    # the delay of the sensor is the camera's own: its mean here is that of the two directions
    delay = (800 + 1_500) / 2 - 700 * np.log(1 - ONSET)
    assert abs(found.camera(3e6) - delay - (offset + (1 + drift) * 3e6)) < 300
    assert abs(found.drift - drift) < 5e-6
    assert found.used >= host.size - 8
    assert found.residual < 200


@pytest.mark.parametrize(("drift", "gap"), [(490e-6, 40e6), (-200e-6, 300e6), (450e-6, 600e6)])
def test_a_clock_that_drifts_by_many_frames_during_a_long_video(drift, gap):
    before, up = shown(2e6)
    after, down = shown(5e6 + gap)
    host, bright = np.concatenate((before, after)), np.concatenate((up, down))
    camera = 1e6 + (1 + drift) * host
    found = fit_clock(seen(camera, bright, video=(7e6, 9e6), noise=1_000), host, bright)
    assert found.drift == pytest.approx(drift, abs=1e-6)
    assert found.used == host.size


def test_a_fifth_of_the_flashes_a_frame_late_on_one_side():
    before, up = shown(1e6)
    after, down = shown(8e6)
    host, bright = np.concatenate((before, after)), np.concatenate((up, down))
    late = np.zeros(host.size)
    late[[1, 2, 7, 10, 12]] = FRAME
    camera = 3e6 + (1 + 50e-6) * (host + late)
    found = fit_clock(seen(camera, bright), host, bright)
    assert abs(found.drift - 50e-6) < 5e-6
    assert found.used == host.size - 5


def test_times_go_there_and_back():
    line = ClockFit(1_234_567.0, 80e-6, 0.0, 10, 10)
    assert line.host(line.camera(9e6)) == pytest.approx(9e6)


def test_what_shows_no_flashes_is_no_sync():
    host, bright = shown(1e6)
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(0, 5_000_000, 300_000))
    noise = Events(t, t % 240, t % 180, rng.integers(0, 2, t.size), (240, 180))
    with pytest.raises(NoSync, match=r"flashes"):
        fit_clock(noise, host, bright)
    with pytest.raises(NoSync, match="0 events"):
        fit_clock(Events([], [], [], [], (240, 180)), host, bright)
    with pytest.raises(NoSync, match="2 flashes"):
        fit_clock(noise, host[:2], bright[:2])


def test_another_clock_is_no_sync():
    host, bright = (np.concatenate(parts) for parts in zip(shown(1e6), shown(4e6), strict=True))
    with pytest.raises(NoSync):
        fit_clock(seen(1e6 + 1.002 * host, bright), host, bright)


def test_the_pattern_is_like_itself_nowhere_else():
    bits = 2 * flashes().astype(int) - 1
    assert set(bits.tolist()) == {-1, 1}
    for shift in range(1, 31):
        assert abs((bits * np.roll(bits, shift)).sum()) == 1
    # one flash by itself comes first; a shorter pattern is the beginning of the whole one
    assert flashes()[:5].tolist() == [1, 0, 0, 0, 0]
    assert flashes(17).tolist() == flashes()[:17].tolist()


@pytest.mark.parametrize("seed", range(3))
def test_triggers_of_a_photodiode_with_others_between(seed):
    rng = np.random.default_rng(seed)
    (before, up), (after, down) = shown(2e6), shown(9e6)
    host, bright = np.concatenate((before, after)), np.concatenate((up, down))
    camera = 5e5 + (1 + 80e-6) * host
    times = camera[bright] + 300 + rng.normal(0, 20, bright.sum())
    others = rng.uniform(camera[0] + 2e6, camera[-1], 40)
    found = fit_clock(np.sort(np.concatenate((times[1:], others))).tolist(), host, bright)
    assert abs(found.drift - 80e-6) < 5e-6
    assert abs(found.camera(2e6) - 300 - (5e5 + (1 + 80e-6) * 2e6)) < 50
    assert found.flashes == bright.sum()
    with pytest.raises(NoSync, match="0 triggers"):
        fit_clock([], host, bright)


def test_a_screen_that_changes_line_by_line_begins_when_its_first_line_does():
    host, bright = (np.concatenate(parts) for parts in zip(shown(1e6), shown(6e6), strict=True))
    t, p = [], []
    rng = np.random.default_rng(0)
    for at, up in zip(host, bright, strict=True):
        t.append(at + rng.uniform(0, 15_000, 8_000))
        p.append(np.full(8_000, up))
    t, p = np.concatenate(t), np.concatenate(p)
    order = np.argsort(t)
    seen_so = Events(t[order].astype(np.int64), np.zeros(t.size, int), np.zeros(t.size, int), p[order], (240, 180))
    found = fit_clock(seen_so, host, bright)
    assert abs(found.camera(1e6) - 1e6 - ONSET * 15_000) < 100
    assert abs(found.drift) < 5e-6
