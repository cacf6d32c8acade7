"""Settings that a fit finds again in what a hidden sensor gave."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from nvsdata import Events
from nvsdata.emulation import DVS, Fit, fit
from nvsdata.emulation.fitting import PER_PIXEL
from nvsdata.video.frames import VideoFrame

TEXTURE = cv2.GaussianBlur(np.random.default_rng(0).random((140, 400)).astype(np.float32), (0, 0), 4)
TEXTURE = cv2.normalize(TEXTURE, None, 0, 250, cv2.NORM_MINMAX)
STEP, FRAMES = 40, 7  # ms from frame to frame, of which the sensor sees each ms


def scene(milliseconds):
    """A texture that swings to and fro above a still floor."""
    shift = 30 + 12 * np.sin(milliseconds / 40)
    moved = cv2.warpAffine(TEXTURE, np.float32([[1, 0, -shift], [0, 1, 0]]), (128, 96))
    moved[64:] = 120
    return np.rint(moved).astype(np.uint8)


def seen(sensor, delay=0, start=0):
    """Frames with times, and events, of one sensor's clock, which events reach `delay` µs late."""
    video = [scene(ms) for ms in range(STEP * (FRAMES - 1) + 1)]
    events = sensor.emulate(video, fps=1_000)
    frames = [VideoFrame(start + 1_000 * STEP * n, video[STEP * n]) for n in range(FRAMES)]
    columns = events.columns
    return frames, Events(columns.t + start + delay, columns.x, columns.y, columns.p, events.sensor_size)


@pytest.mark.parametrize(
    ("on", "off", "dark", "least", "most"), [(0.2, 0.3, 1.0, 1, 2), (0.35, 0.25, 12.0, 8, 20), (0.2, 0.2, 30, 20, 45)]
)
def test_thresholds_and_darkness_are_found_again(on, off, dark, least, most):
    frames, events = seen(DVS(on=on, off=off, dark=dark))
    found = fit(frames, events, base=DVS(upsample="flow"))
    assert isinstance(found, Fit)
    assert least <= found.settings.dark <= most
    assert abs(found.settings.on / on - 1) < 0.15
    assert abs(found.settings.off / off - 1) < 0.15
    assert found.correlation > 0.9
    assert found.settings.upsample == "flow"
    assert (found.settings.leak, found.settings.noise_rate) == (0, 0)
    assert found.unidentified == {"refractory": "pixels don't fire again soon enough to reach this period"}
    ours = found.settings.emulate(frames)
    for p in (0, 1):
        assert abs((ours.p == p).sum() / (events.p == p).sum() - 1) < 0.02


@pytest.mark.parametrize("delay", [-3_400, 0, 6_700])
def test_delays_are_found(delay):
    frames, events = seen(DVS(on=0.2, off=0.2), delay, start=10**15)
    found = fit(frames, events)
    # a delay of 0 may look like some of a frame's 40 ms: events come after the light has changed
    assert abs(found.delay - delay) < 1_500
    assert fit(frames, events, delay=delay).delay == delay


def test_noise_and_leak_are_found_where_light_is_constant():
    frames, events = seen(DVS(on=0.2, off=0.25, leak=2.0, noise_rate=4.0, seed=3))
    found = fit(frames, events, delay=0).settings
    assert abs(found.leak / 2 - 1) < 0.2
    assert abs(found.noise_rate / 4 - 1) < 0.2
    assert abs(found.on / 0.2 - 1) < 0.3
    quiet = fit(frames, events, delay=0, noise=False, base=DVS(noise_rate=0.5)).settings
    assert (quiet.leak, quiet.noise_rate) == (0, 0.5)
    assert quiet.on < found.on


def test_blindness_after_events_is_found():
    frames, events = seen(DVS(on=0.05, off=0.05, refractory=3_000))
    found = fit(frames, events, delay=0)
    assert 3_000 <= found.settings.refractory < 3_300


def test_pixels_have_thresholds_of_their_own():
    frames, events = seen(DVS(on=0.05, off=0.08))
    found = fit(frames, events, delay=0)
    counts = np.zeros((2, 96, 128), int)
    np.add.at(counts, (events.p, events.y, events.x), 1)
    assert found.thresholds.shape == (2, 96, 128)
    assert (np.isfinite(found.thresholds) <= (counts >= PER_PIXEL)).all()
    off, on = np.nanmedian(found.thresholds, axis=(1, 2))
    assert 0.4 < off / 0.08 < 1.1
    assert 0.4 < on / 0.05 < 1.1


def test_what_a_pair_does_not_tell_is_said():
    frames, events = seen(DVS(on=0.2, off=0.2))
    rising = events.select(events.p == 1) if hasattr(events, "select") else events[events.p == 1]
    found = fit(frames, rising, delay=0, base=DVS(off=0.77))
    assert found.settings.off == 0.77
    said = found.unidentified["off"]
    ours = (found.settings.emulate(frames).p == 0).sum()
    assert (
        said == f"0 events of this polarity, at least 100 are needed; {ours} events are emulated, but the sensor has 0"
    )
    assert "on" not in found.unidentified
    moving = [replace_pixels(frame, 64) for frame in frames]
    cut = events[events.y < 64]
    cut = Events(cut.t, cut.x, cut.y, cut.p, (128, 64))
    found = fit(moving, cut, delay=0, base=DVS(leak=0.3, refractory=7, upsample="flow"))
    assert set(found.unidentified) <= {"leak", "noise_rate", "refractory"}
    assert "pixel-seconds of constant light, 100 are needed" in found.unidentified["leak"]
    assert found.settings.leak == 0.3
    few = fit(frames, events[::20], delay=0, base=DVS(refractory=7))
    assert "intervals between events of a pixel, 1000 are needed" in few.unidentified["refractory"]
    assert few.settings.refractory == 7


def replace_pixels(frame, rows):
    return frame._replace(pixels=np.ascontiguousarray(frame.pixels[:rows]))


def test_thresholds_that_no_setting_gives_are_said():
    frames, events = seen(DVS(on=0.2, off=0.2))
    storm = [np.repeat(column, 60) for column in events[events.p == 1].columns]
    both = Events(
        *(np.concatenate((a, b)) for a, b in zip(storm, events[events.p == 0].columns, strict=True)), (128, 96)
    )
    found = fit(frames, both, delay=0, noise=False)
    assert "no threshold from 0.01 to 3.0 results in" in found.unidentified["on"]
    assert found.settings.on == DVS().on
    # if it is so of both, there is nothing to return
    storm = Events(*(np.repeat(column, 60) for column in events.columns), events.sensor_size)
    with pytest.raises(
        ValueError,
        match=r"neither threshold \(off: no threshold from 0.01 to 3.0 results in .* are emulated, but the sensor",
    ):
        fit(frames, storm, delay=0, noise=False)


def test_pairs_that_cannot_be_fitted():
    frames, events = seen(DVS(on=0.2, off=0.2))
    with pytest.raises(ValueError, match="2 frames: a fit needs at least 3"):
        fit(frames[:2], events)
    with pytest.raises(ValueError, match="frames are 128x64, events of 128x96"):
        fit([replace_pixels(frame, 64) for frame in frames], events)
    with pytest.raises(ValueError, match="no time in common: frames from 0 to 240000 µs, events from"):
        fit(frames, Events(events.t + 10**9, events.x, events.y, events.p, events.sensor_size))
    mirrored = Events(events.t, 127 - events.x, 95 - events.y, 1 - events.p, events.sensor_size)
    with pytest.raises(ValueError, match="events don't follow the frames: their correlation is"):
        fit(frames, mirrored)
    with pytest.raises(ValueError, match="frame 3 has no time"):
        fit([frame.pixels for frame in frames], events, times=[0, 10, 20])


def test_a_fit_is_the_same_for_arrays_and_times():
    frames, events = seen(DVS(on=0.2, off=0.2), start=5_000)
    times = [frame.time for frame in frames]
    found = fit([frame.pixels for frame in frames], events, times=times)
    assert found.settings == fit(frames, events).settings
    assert found.settings == replace(found.settings)


def still(noise=0.0, dark=1):
    """A still scene, whose frames may have noise of their own."""
    rng = np.random.default_rng(0)
    pixels = scene(0) // dark
    noisy = [np.clip(pixels + rng.normal(0, noise, pixels.shape), 0, 255).astype(np.uint8) for _ in range(FRAMES)]
    return [VideoFrame(1_000 * STEP * n, frame) for n, frame in enumerate(noisy)]


def anywhere(count):
    """Events at random places and times."""
    rng = np.random.default_rng(1)
    t = np.sort(rng.integers(0, 240_000, count))
    return Events(t, rng.integers(0, 128, count), rng.integers(0, 96, count), rng.integers(0, 2, count), (128, 96))


def test_a_still_scene_shows_no_thresholds():
    with pytest.raises(
        ValueError, match=r"^nothing moves in these frames: light changes by less than 5% at each pixel"
    ):
        fit(still(), anywhere(1_795))
    # its leak and noise give as many events as there are
    found = fit(still(), anywhere(1_795), delay=0)
    assert {"off", "on", "dark"} <= found.unidentified.keys()
    assert abs(len(found.settings.emulate(still())) / 1_795 - 1) < 0.1
    with pytest.raises(ValueError, match=r"neither threshold .* 0 events are emulated, but the sensor has 1795"):
        fit(still(), anywhere(1_795), delay=0, noise=False)
    # frames change by their own noise only, which is no light
    for noise, dark in ((1, 20), (2, 20), (5, 1)):
        frames = still(noise, dark)
        with pytest.raises(ValueError, match=r"events don't follow the frames.*; if nothing moves, delay=0 estimates"):
            fit(frames, anywhere(1_795))
        with pytest.raises(ValueError, match=r"events don't follow the frames|neither threshold"):
            fit(frames, anywhere(1_795), delay=0, noise=False)


@pytest.mark.parametrize("noise", [2, 5])
def test_leak_and_noise_are_found_in_a_still_scene_whose_frames_have_noise(noise):
    frames = still(noise, dark=10)
    mean = np.mean([frame.pixels for frame in frames], axis=0).round().astype(np.uint8)
    mean = [frame._replace(pixels=mean) for frame in frames]
    events = DVS(leak=2.0, noise_rate=4.0, seed=3).emulate(mean)
    found = fit(frames, events, delay=0)
    assert abs(found.settings.leak / 2 - 1) < 0.1
    assert abs(found.settings.noise_rate / 4 - 1) < 0.1
    # the frames' own noise gives many more events; that of their mean, as many as the sensor
    assert len(found.settings.emulate(frames)) > 1.2 * len(events)
    assert abs(len(found.settings.emulate(mean)) / len(events) - 1) < 0.03
    assert found.unidentified["on"].startswith("nothing moves, but thresholds need motion; ")
    assert found.unidentified["on"].endswith("because these frames are noisy: emulate their mean")
    assert found.intervals == {}


def test_intervals_contain_the_true_settings():
    frames = [VideoFrame(1_000 * STEP * n, scene(STEP * n)) for n in range(FRAMES)]
    rng, inside = np.random.default_rng(5), dict.fromkeys(("on", "off", "dark"), 0)
    for seed in range(20):
        on, off = rng.uniform(0.12, 0.4, 2)
        true = DVS(on=on, off=off, dark=np.exp(rng.uniform(1, 4.5)), mismatch=0.1, noise_rate=1.0, seed=seed + 10)
        found = fit(frames, true.emulate(frames), delay=0, base=DVS(mismatch=0.1, seed=seed))
        for name in inside:
            low, high = found.intervals[name]
            assert low <= getattr(found.settings, name) <= high
            inside[name] += low <= getattr(true, name) <= high
    # of 95% intervals, 19 of 20
    assert min(inside.values()) >= 17, inside


def test_dark_is_searched_beyond_the_values_tried_first():
    frames, _ = seen(DVS())
    found = fit(frames, DVS(on=0.1, off=0.1, dark=130, mismatch=0.1, seed=1).emulate(frames), delay=0)
    low, high = found.intervals["dark"]
    assert 64 < low < 130 < high
    assert "dark" not in found.unidentified
    # a pixel that sees light, not its logarithm
    found = fit(frames, DVS(on=0.002, off=0.002, dark=10_000).emulate(frames), delay=0)
    assert found.settings.dark == 1_000
    assert found.unidentified["dark"] == "1000 gray levels fit best, where the search ends"


@pytest.mark.parametrize("delay", [-30_000, 37_000])
def test_delays_are_searched_beyond_the_values_tried_first(delay):
    frames, events = seen(DVS(on=0.1, off=0.1), delay)
    found = fit(frames, events)
    low, high = found.intervals["delay"]
    assert low <= found.delay <= high
    assert abs(found.delay - delay) < 1_500


def test_events_that_do_not_follow_the_light_fit_no_thresholds():
    frames, _ = seen(DVS(on=0.2, off=0.2))
    with pytest.raises(ValueError, match=r"neither threshold .* events are emulated, but the sensor has 1795"):
        fit(frames, anywhere(1_795), delay=0)
    with pytest.raises(ValueError, match=r"their correlation is -?0.0. with a delay of 0 µs"):
        fit(frames, anywhere(1_795), delay=0, noise=False)


@pytest.mark.parametrize(
    "sensor",
    [
        DVS(on=0.2, off=0.3),
        DVS(on=1.0, off=0.9),  # events become fewer ten times as fast as such thresholds rise
        DVS(on=0.2, off=0.25, leak=20.0, seed=3),  # memories that fall delay OFF events
        DVS(on=0.2, off=0.25, noise_rate=30.0, seed=3),
        DVS(on=0.05, off=0.05, refractory=3_000),
        DVS(on=0.2, off=0.2, hot_pixels=0.01),
    ],
    ids=repr,
)
def test_what_is_found_gives_as_many_events_as_the_sensor(sensor):
    frames, events = seen(sensor)
    found = fit(frames, events, delay=0)
    assert not {"on", "off"} & found.unidentified.keys()
    ours = found.settings.emulate(frames)
    for p in (0, 1):
        assert abs((ours.p == p).sum() / (events.p == p).sum() - 1) < 0.02


def test_few_events_are_enough():
    frames, events = seen(DVS(on=0.2, off=0.2))
    found = fit(frames, events[::100], delay=0)
    assert abs(len(found.settings.emulate(frames)) / (len(events) / 100) - 1) < 0.02
    with pytest.raises(
        ValueError, match=r"off: \d\d events of this polarity, at least 100 are needed; on: \d\d events"
    ):
        fit(frames, events[::400], delay=0)
