"""DVS against its definition, pixel by pixel in float64, and against itself without skipping."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsdata.emulation import DVS
from nvsdata.emulation.dvs_state import DVSState
from nvsdata.video.frames import VideoFrame

GAP = 33_333  # µs


def defined(emulator, frames, times, on=None, off=None, begin=None):
    """Events (t, y, x, p) of gray frames by the definition; `on` and `off` [H, W] are the pixels' thresholds."""
    height, width = frames[0].shape
    on = np.full((height, width), emulator.on) if on is None else on
    off = np.full((height, width), emulator.off) if off is None else off
    fall = emulator.leak * emulator.on / 1e6
    found = []
    for y in range(height):
        for x in range(width):
            light = [math.log(float(frame[y, x]) + emulator.dark) for frame in frames]
            seen = followed(emulator, light, times)
            memory = light[0] - (0 if begin is None else begin[y, x])
            for (t0, a), (t1, b) in pairwise(seen):
                # the memory falls meanwhile: the line of their difference
                d0, d1 = a - memory + fall * t0, b - memory + fall * t1
                up = d1 > 0
                step = on[y, x] if up else off[y, x]
                for k in range(1, int(abs(d1) / step) + 1):
                    level = k * step if up else -k * step
                    moment = t0 + (t1 - t0) * (level - d0) / (d1 - d0)
                    found.append((math.floor(moment + 0.5), y, x, int(up)))
                    memory += step if up else -step
    return sorted(found)


def followed(emulator, light, times, steps=1000):
    """Where a photoreceptor is: at each frame if it follows at once, else after each of many small steps between."""
    if not emulator.cutoff:
        return list(zip(times, light, strict=True))
    here, seen = light[0], [(times[0], light[0])]
    for t0, t1, a, b in zip(times, times[1:], light, light[1:], strict=False):
        for i in range(steps):
            target = a + (b - a) * (i + 0.5) / steps
            rate = 2 * math.pi * emulator.cutoff / 1e6 * (math.exp(target) - emulator.dark + 20) / 275
            here = target + (here - target) * math.exp(-rate * (t1 - t0) / steps)
            seen.append((t0 + (t1 - t0) * (i + 1) / steps, here))
    return seen


def moving(count, height=12, width=70, seed=0, share=0.3):
    """Gray frames of which a part changes from one to the next, most of it in one tile."""
    rng = np.random.default_rng(seed)
    frames = [rng.integers(0, 256, (height, width)).astype(np.uint8)]
    for n in range(count - 1):
        frame = frames[-1].copy()
        if n % 3 != 2:
            some = rng.random((height, width)) < share
            some[8:] &= n % 2 == 0
            frame[some] = rng.integers(0, 256, int(some.sum()))
        frames.append(frame)
    return frames


def rows(events):
    return sorted(zip(events.t.tolist(), events.y.tolist(), events.x.tolist(), events.p.tolist(), strict=True))


def agree(found, expected, apart=4):
    """The same events, at times up to `apart` µs from each other, nearly all at most 1: float32 shifts those at the end
    of a small change.
    """
    by_pixel = [sorted((y, x, p, t) for t, y, x, p in some) for some in (found, expected)]
    assert [row[:3] for row in by_pixel[0]] == [row[:3] for row in by_pixel[1]]
    times = [np.array([row[3] for row in some]) for some in by_pixel]
    assert np.abs(times[0] - times[1]).max(initial=0) <= apart
    assert (np.abs(times[0] - times[1]) > 1).mean() < 2e-3


# thresholds that no way there and back meets exactly
APART = {"on": 0.3, "off": 0.2837}


@pytest.mark.parametrize(
    "emulator",
    [
        DVS(**APART),
        DVS(on=0.17, off=0.41),
        DVS(on=0.011, off=0.0131, dark=0.5),
        DVS(leak=2.0, **APART),
    ],
    ids=str,
)
def test_events_are_those_of_the_definition(emulator):
    frames = moving(9)
    times = [round(n * 1e6 / 30) for n in range(9)]
    begin = DVSState(emulator, VideoFrame(0, frames[0]))._array
    events = emulator.emulate(frames)
    expected = defined(emulator, frames, times, begin=(begin.level - begin.memory).astype(float))
    assert len(expected) > 1_000
    agree(rows(events), expected)


@pytest.mark.parametrize(
    ("emulator", "gap"),
    [(DVS(cutoff=20, **APART), GAP), (DVS(cutoff=5, leak=1.0, **APART), GAP), (DVS(cutoff=200, **APART), 500_000)],
    ids=str,
)
def test_photoreceptors_are_late_by_what_their_bandwidth_says(emulator, gap):
    frames = moving(5, height=9, width=12, share=0.5)
    times = [n * gap for n in range(5)]
    begin = DVSState(emulator, VideoFrame(0, frames[0]))._array
    ours = rows(emulator.emulate([VideoFrame(time, frame) for time, frame in zip(times, frames, strict=True)]))
    exact = defined(emulator, frames, times, begin=(begin.level - begin.memory).astype(float))
    assert len(exact) > 150
    assert abs(len(ours) / len(exact) - 1) < 0.005
    tables = [{}, {}]
    for table, events in zip(tables, (ours, exact), strict=True):
        for t, *place in events:
            table.setdefault(tuple(place), []).append(t)
    alike = [place for place in tables[1] if len(tables[0].get(place, ())) == len(tables[1][place])]
    assert len(alike) > 0.98 * len(tables[1])
    late = np.concatenate([np.abs(np.subtract(tables[0][place], tables[1][place])) for place in alike])
    constant = 1e6 / (2 * math.pi * emulator.cutoff)
    # the rate is constant while light changes by a tenth
    assert np.median(late) < 0.06 * constant
    assert np.quantile(late, 0.99) < 0.15 * constant


def test_constant_light_is_followed_along_an_exponential():
    emulator = DVS(on=0.2, off=0.3, cutoff=10)
    shown = [VideoFrame(0, np.full((1, 2), 20, np.uint8)), VideoFrame(1, np.array([[250, 3]], np.uint8))]
    events = emulator.emulate([*shown, VideoFrame(10_000_000, shown[1].pixels)])
    for x, step, target, up in ((0, 0.2, 250, 1), (1, 0.3, 3, 0)):
        way = abs(math.log((target + 3) / 23))
        rate = 2 * math.pi * 10 / 1e6 * (target + 20) / 275
        expected = [-math.log(1 - k * step / way) / rate for k in range(1, int(way / step) + 1)]
        found = events.t[(events.x == x) & (events.p == up)]
        np.testing.assert_allclose(found, expected, atol=2)
    assert len(events) == int(math.log(253 / 23) / 0.2) + int(math.log(23 / 6) / 0.3)


def test_long_still_light_is_followed_as_short_light_is():
    # in the end nothing is left of the exponential
    shown = [VideoFrame(0, np.full((1, 1), 20, np.uint8)), VideoFrame(1_000, np.full((1, 1), 200, np.uint8))]
    fast = DVS(on=0.02, off=0.02, cutoff=5_000)
    found = [fast.emulate([*shown, VideoFrame(end, shown[1].pixels)]).t for end in (6_000, 41_000, 10**9)]
    assert found[0][-1] < 1_100
    assert all(np.array_equal(found[0], other) for other in found[1:])


def test_a_receptor_that_falls_while_its_memory_leaks():
    stills = [np.full((1, 1), value, np.uint8) for value in (250, 60, 60)]
    times = [0, 10_000, 400_000]
    emulator = DVS(on=0.3, off=0.1, cutoff=24, leak=0.5)
    first = DVSState(emulator, VideoFrame(0, stills[0]))._array
    events = emulator.emulate([VideoFrame(time, still) for time, still in zip(times, stills, strict=True)])
    exact = defined(emulator, stills, times, begin=(first.level - first.memory).astype(float))
    assert events.p.tolist() == [p for *_, p in exact]
    np.testing.assert_allclose(events.t, [t for t, *_ in exact], atol=300)


def test_tiles_with_a_leak_sleep_again_after_a_step():
    emulator = DVS(cutoff=100, leak=0.01)
    run = DVSState(emulator, VideoFrame(0, np.full((64, 640), 20, np.uint8)))
    run._array.memory[:] = run._array.level
    for n in range(1, 200):
        run.step(VideoFrame(1_000 * n, np.full((64, 640), 200, np.uint8)))
    assert (run._array.wake > 10**6).all()


def test_a_receptor_that_turns_gives_events_of_both_polarities_between_two_frames():
    # it still rises towards white when the light falls below it
    stills = [np.full((1, 1), value, np.uint8) for value in (10, 255, 1)]
    times = [0, 1_000, 300_000]
    frames = [VideoFrame(time, still) for time, still in zip(times, stills, strict=True)]
    emulator = DVS(on=0.05, off=0.05, cutoff=60)
    between = emulator.emulate(frames)
    last = between.window(1_000, None)
    assert last.p[0] == 1
    assert last.p[-1] == 0
    assert (np.diff(last.p.astype(int)) != 0).sum() == 1
    exact = defined(emulator, stills, times)
    assert [(p, x) for _, _, x, p in rows(between)] == [(p, x) for _, _, x, p in exact]
    assert np.abs(between.t - [t for t, *_ in exact]).max() < 300


def test_a_receptor_that_is_slower_than_the_frames_goes_on_after_them():
    frames = [VideoFrame(0, np.full((2, 2), 20, np.uint8)), VideoFrame(40_000, np.full((2, 2), 200, np.uint8))]
    rest = [VideoFrame(2_040_000, np.full((2, 2), 200, np.uint8))]
    seen = [
        DVS(on=0.1, cutoff=10).emulate([*frames, *more, *rest])
        for more in ([], [VideoFrame(40_000 + 5_000 * n, frames[1].pixels) for n in range(1, 399)])
    ]
    # however many frames show it
    assert len(seen[0]) == len(seen[1])
    assert np.abs(seen[0].t - seen[1].t).max() < 1_500
    assert 12_000 < seen[0].t[0] < 20_000
    assert seen[0].t[-1] < 110_000


def test_colors_and_floats_give_the_levels_of_their_luminance():
    colors = np.random.default_rng(1).integers(0, 256, (5, 9, 66, 3)).astype(np.uint8)
    gray = colors.astype(np.float64) @ (0.299, 0.587, 0.114)
    times = [round(n * 1e6 / 30) for n in range(5)]
    expected = defined(DVS(**APART), list(gray), times)
    agree(rows(DVS(**APART).emulate(colors)), expected)
    agree(rows(DVS(**APART).emulate(list(gray / 255))), expected)
    tiny = DVS(on=0.04, off=0.039)
    agree(rows(tiny.emulate(colors)), defined(tiny, list(gray), times))


def test_thresholds_of_pixels_differ_around_the_nominal_ones():
    frames = moving(6, seed=3)
    emulator = DVS(mismatch=0.2, seed=5, **APART)
    off, on = DVSState(emulator, VideoFrame(0, frames[0]))._sensor.each.astype(float)
    assert on.min() >= 0.03 * 0.99
    assert off.min() >= 0.02837 * 0.99
    for own, nominal in ((on, 0.3), (off, 0.2837)):
        assert abs(own.mean() / nominal - 1) < 0.03
        assert abs(own.std() / nominal / 0.2 - 1) < 0.1
    assert abs(np.corrcoef(on.ravel(), off.ravel())[0, 1]) < 0.1
    times = [round(n * 1e6 / 30) for n in range(6)]
    agree(rows(emulator.emulate(frames)), defined(emulator, frames, times, on, off))
    assert rows(emulator.emulate(frames)) != rows(replace(emulator, seed=6).emulate(frames))


class Restless(DVSState):
    """Looks at every tile in every frame."""

    def _spikes(self, frame, last):
        self._array.wake[:] = 0
        return super()._spikes(frame, last)


OPTIONS = st.fixed_dictionaries(
    {
        "on": st.floats(0.02, 0.6),
        "off": st.floats(0.02, 0.6),
        "mismatch": st.sampled_from([0.0, 0.3]),
        "cutoff": st.sampled_from([0.0, 3.0, 200.0]),
        "leak": st.sampled_from([0.0, 0.5, 20.0]),
        "seed": st.integers(0, 9),
    }
)


@settings(max_examples=40, deadline=None)
@given(OPTIONS, st.integers(0, 99), st.sampled_from([0.0, 0.02, 0.5]), st.booleans())
def test_skipped_tiles_change_nothing(options, seed, share, colored):
    frames = moving(12, height=20, width=130, seed=seed, share=share)
    if colored:
        frames = [np.repeat(frame[..., None], 3, axis=2) for frame in frames]
    emulator = DVS(**options)
    found = []
    for kind in (DVSState, Restless):
        run = kind(emulator, VideoFrame(0, frames[0]))
        found.append([run.step(VideoFrame(n * GAP, frame)).keys.copy() for n, frame in enumerate(frames) if n])
    for ours, theirs in zip(*found, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_tiles_that_do_not_change_are_left_out():
    frames = moving(5, share=0.0)
    still = DVSState(DVS(), VideoFrame(0, frames[0]))
    leaking = DVSState(DVS(leak=0.01), VideoFrame(0, frames[0]))
    for n in range(1, 5):
        assert still.step(VideoFrame(n * GAP, frames[n])).keys.size == 0
        leaking.step(VideoFrame(n * GAP, frames[n]))
    assert (still._array.wake > 2**61).all()
    # the first of 512 pixels fires after about 1 / 512 of 100 s
    assert (leaking._array.wake > 4 * GAP).mean() > 0.2


def test_a_step_is_seen_at_once_and_counted_fully():
    frames = [np.full((4, 4), value, np.uint8) for value in (10, 10, 200, 200, 10)]
    events = DVS(on=0.25, off=0.4).emulate(frames, fps=100)
    rise = math.log(203 / 13)
    assert np.bincount(events.p, minlength=2).tolist() == [16 * int(2.5 / 0.4), 16 * int(rise / 0.25)]
    first = events.t[events.p == 1][0]
    assert first == round(10_000 + 10_000 * 0.25 / rise)


def test_small_changes_add_up():
    frames = [np.full((2, 2), 100 + n, np.uint8) for n in range(100)]
    for every in (1, 3, 9):
        events = DVS(on=0.1).emulate(frames[::every], fps=300 / every)
        assert len(events) == 4 * int(math.log(202 / 103) / 0.1), every


def test_memory_leaks_at_its_rate_from_random_places():
    frames = [np.full((30, 40), 90, np.uint8)] * 51
    events = DVS(leak=2.0, seed=1).emulate(frames, fps=10)
    assert (events.p == 1).all()
    counts = np.bincount(events.y.astype(int) * 40 + events.x, minlength=1200)
    assert set(counts.tolist()) == {10}
    assert np.diff(np.histogram(events.t[:1200], 10, (0, 500_000))[0]).max() < 60


def test_noise_is_rarer_where_it_is_bright():
    frame = np.zeros((40, 40), np.uint8)
    frame[:, 20:] = 255
    events = DVS(noise_rate=5, seed=2).emulate([frame] * 61, fps=3)
    dark, bright = (events.x < 20).sum(), (events.x >= 20).sum()
    assert abs(dark / (5 * 20 * 800) - 1) < 0.02
    assert abs(bright / dark - 0.25) < 0.01
    assert abs((events.p == 1).mean() - 0.5) < 0.01


def test_blind_pixels_do_not_show_what_they_miss():
    frames = [np.full((2, 2), value, np.uint8) for value in (10, 200)]
    every = DVS(on=0.1).emulate(frames, fps=100)
    some = DVS(on=0.1, refractory=1_000).emulate(frames, fps=100)
    pixel = every.t[(every.x == 0) & (every.y == 0)]
    kept = [pixel[0]]
    for t in pixel[1:]:
        kept += [t] if t >= kept[-1] + 1_000 else []
    assert some.t[(some.x == 0) & (some.y == 0)].tolist() == kept
    assert len(kept) < len(pixel)


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"on": 0}, "on must be at least"),
        ({"off": math.nan}, "off must be at least"),
        ({"dark": 0}, "dark must be at least"),
        ({"cutoff": -1}, "cutoff must not be negative"),
        ({"leak": math.inf}, "leak must not be negative"),
        ({"hot_pixels": 1.5}, "hot_pixels must be between 0 and 1"),
        ({"seed": 1 << 63}, "seed must be below"),
        ({"seed": 0.5}, "seed must be a whole number"),
        ({"upsample": 2.0}, "upsample must be a whole number of at least 1, not 2.0"),
        ({"upsample": 0}, "upsample must be a whole number"),
        ({"upsample": "sideways"}, "upsample must be a number or one of"),
    ],
)
def test_settings_out_of_range_are_refused(wrong, word):
    with pytest.raises(ValueError, match=word):
        DVS(**wrong)
