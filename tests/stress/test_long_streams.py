"""PIX2NVS over very many frames, in the dark, and at a pixel's very threshold, against float64."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from nvsdata.emulation import PIX2NVS
from nvsdata.emulation.pix2nvs_state import PIX2NVSState
from nvsdata.video.frames import VideoFrame

SHAPE = (2, 4)
DARK = PIX2NVS(continuous=True, t_log=20)


def tones(settings):
    """(3.1) of each gray value, float64."""
    slope = math.log(settings.t_log) / settings.t_log if settings.continuous and settings.t_log else 1
    return np.array([math.log(q) if q > settings.t_log else q * slope for q in range(256)])


def emulated(settings, frames):
    """The emulator after all frames, and how many events each gave."""
    emulator = PIX2NVSState(settings, VideoFrame(0, frames[0]))
    return emulator, [emulator.step(VideoFrame(n, frame)).keys.size for n, frame in enumerate(frames[1:], 1)]


def exact(settings, frames):
    """(3.10) and (3.8) in float64: the last reference, events of each frame, and whether one is doubtful.

    It is doubtful if a difference is so near a multiple of the threshold that float32 may see it on the other side.
    """
    level = tones(settings)[frames].reshape(len(frames), -1)
    alpha = settings.alpha
    reference = lfilter([alpha], [1, alpha - 1], level, 0, zi=(1 - alpha) * level[:1])[0]
    ratio = np.abs(level[1:] - reference[:-1]) / settings.threshold
    count = np.minimum(np.floor(ratio), settings.max_events).sum(1)
    doubtful = (np.abs(ratio - np.round(ratio)) * settings.threshold < 3e-5).any(1)
    return reference[-1].reshape(frames.shape[1:]), count, doubtful


def noise(count):
    """Each pixel anything, in each frame."""
    return np.random.default_rng(0).integers(0, 256, (count, *SHAPE), dtype=np.uint8)


def flicker(count):
    """Black and white in turn."""
    return np.repeat(np.arange(count) % 2 * 255, 8).reshape(count, *SHAPE).astype(np.uint8)


def toggling(count):
    """Steps of one level in turn, which the reference follows and never fires."""
    return np.repeat(100 + np.arange(count) % 2, 8).reshape(count, *SHAPE).astype(np.uint8)


LENGTHS = [10_000, pytest.param(1_000_000, marks=pytest.mark.long)]


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize(
    ("settings", "frames"),
    [
        (PIX2NVS(), noise),
        (PIX2NVS(), flicker),
        (PIX2NVS(alpha=0.01), noise),
        (PIX2NVS(alpha=0.01), flicker),
        (PIX2NVS(alpha=0.01), toggling),
        (PIX2NVS(alpha=0.01, threshold=0.04), noise),
        (PIX2NVS(alpha=0.0001), flicker),
        (PIX2NVS(alpha=0.000001), flicker),
        (DARK, flicker),
    ],
    ids=lambda thing: getattr(thing, "__name__", None),
)
def test_the_moving_average_does_not_drift(length, settings, frames):
    """Rounding errors of float32 fade as the average forgets: they stay below half a unit in the last place / alpha."""
    frames = frames(length)
    emulator, counts = emulated(settings, frames)
    reference, expected, doubtful = exact(settings, frames)
    # of the last frame, which changed everything
    assert not emulator._tiles.behind.any()
    # smaller alphas take float64
    most = 2.0**-22 / settings.alpha if settings.alpha >= 0.01 else 0
    assert np.abs(emulator._pixels.reference - reference).max() <= most + 1e-6
    assert doubtful.mean() < 0.02
    assert (np.array(counts)[~doubtful] == expected[~doubtful]).all()
    # either side of a threshold is one event of one of the pixels
    assert abs(sum(counts) - expected.sum()) <= doubtful.sum() * frames[0].size


def test_a_hundred_thousand_frames_of_flicker_give_as_many_events_as_ten():
    """Every change from black to white crosses more thresholds than the most that count."""
    settings = PIX2NVS()
    frame = [np.full(SHAPE, value, np.uint8) for value in (0, 255)]
    emulator, total = PIX2NVSState(settings, VideoFrame(0, frame[0])), 0
    for n in range(1, 100_001):
        total += emulator.step(VideoFrame(n, frame[n % 2])).keys.size
    assert total == 100_000 * 8 * settings.max_events


def rate(settings, frames):
    """Events per second and pixel of ten seconds."""
    return len(settings.emulate(list(frames), fps=30)) / (10 * frames.shape[1] * frames.shape[2])


def levels(low, high, *shape):
    """Ten seconds of frames whose values are anything from `low` to `high`."""
    return np.random.default_rng(0).integers(low, high + 1, (301, *shape), dtype=np.uint8)


@pytest.mark.parametrize(
    ("name", "frames", "plain", "linear"),
    [
        ("black and one level, gray", levels(0, 1, 32, 32), 0, 0),
        ("levels 1 and 2, gray", levels(1, 2, 32, 32), 38.1, 0),
        ("levels 0 to 2, gray", levels(0, 2, 32, 32), 33.0, 5.4),
        ("black and one level, color", levels(0, 1, 32, 32, 3), 54.7, 0),
        ("black and one level of blue", levels(0, 1, 32, 32, 3) * np.array([0, 0, 1], np.uint8), 73.4, 0),
        ("levels 0 to 2, color", levels(0, 2, 32, 32, 3), 51.8, 0.65),
        ("levels 100 to 101, gray", levels(100, 101, 32, 32), 0, 0),
    ],
)
def test_what_the_dark_costs(name, frames, plain, linear):
    """Near black, a level is a large step of the logarithm; of a linear part up to 20, a small one."""
    assert rate(PIX2NVS(), frames) == pytest.approx(plain, rel=0.03, abs=0.01)
    assert rate(DARK, frames) == pytest.approx(linear, rel=0.1, abs=0.01)


def looks_everywhere(self, frame, last, original=PIX2NVSState._spikes):
    """No tile is as it was, and none is still."""
    found = original(self, frame, last._replace(pixels=~frame.pixels))
    assert self._tiles.dirty.all()
    self._tiles.still[:] = False
    return found


@pytest.mark.parametrize(
    ("threshold", "before", "after"),
    [
        *((0.30403003096580505, *grays) for grays in ((51, 56), (56, 51), (53, 112), (102, 112), (106, 224))),
        (0.34250152111053467, 27, 30),
        (0.2, 100, 140),
    ],
)
def test_tiles_at_the_threshold_of_their_most_sensitive_pixel_are_not_skipped(threshold, before, after, monkeypatch):
    """What is left of a step, times that pixel's sensitivity, is the threshold to the last bit."""
    settings = PIX2NVS(mismatch=0.3, alpha=0.5, seed=1, threshold=threshold)
    frames = [np.full((8, 64), gray, np.uint8) for gray in (before, *[after] * 7)]
    skipping = list(settings.stream(frames, fps=25))
    monkeypatch.setattr(PIX2NVSState, "_spikes", looks_everywhere)
    assert skipping == list(settings.stream(frames, fps=25))
    assert sum(map(len, skipping)) > 0
