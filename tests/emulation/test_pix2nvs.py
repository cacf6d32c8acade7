"""PIX2NVS against the thesis's equations, written out slowly in float64."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsdata.emulation import PIX2NVS, PRESETS
from nvsdata.emulation.pix2nvs_state import PIX2NVSState

DT = 40_000


def slow_tone(s, q):
    if s.mode != "LI":
        return 100 * math.sqrt((q / 255) ** s.gamma)
    return slow_log(s, q)


def slow_log(s, q):
    if q > s.t_log:
        return math.log(q)
    return q * math.log(s.t_log) / s.t_log if s.continuous and s.t_log else q


def slow_level(s, frame):
    height, width = frame.shape[:2]
    base = np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            r, g, b = (float(v) for v in frame[y, x]) if frame.ndim == 3 else [float(frame[y, x])] * 3
            if s.hue:
                q = b / (r + g) if r + g else b
                q = 0.0 if r + g + b == 0 else q
            else:
                q = (299 * r + 587 * g + 114 * b) / 1000
            base[y, x] = slow_tone(s, q)
    if s.mode == "LI":
        return base
    padded = np.pad(base, 1, mode="edge")
    level = np.zeros_like(base)
    for y in range(height):
        for x in range(width):
            here = padded[y + 1, x + 1]
            around = (padded[y, x + 1], padded[y + 2, x + 1], padded[y + 1, x], padded[y + 1, x + 2])
            level[y, x] = sum(abs(here - other) for other in around) / 4
            if s.mode == "LICE":
                level[y, x] = slow_log(s, level[y, x])
    return level


def slow_difference(s, level, reference):
    """Differences, and whether two of a block are too near each other for the larger to be told."""
    doubtful = False
    padded = np.pad(reference, 1, mode="edge")
    d = np.zeros_like(level)
    for y, x in np.ndindex(level.shape):
        if s.difference == "co-located":
            other = reference[y, x]
        elif s.difference == "average":
            other = (padded[y, x + 1] + padded[y + 2, x + 1] + padded[y + 1, x] + padded[y + 1, x + 2]) / 4
        else:
            other = min(padded[y, x], padded[y + 2, x + 2])
        d[y, x] = level[y, x] - other
    for top in range(0, level.shape[0], s.inhibition):
        for left in range(0, level.shape[1], s.inhibition):
            block = d[top : top + s.inhibition, left : left + s.inhibition]
            ranked = np.sort(np.abs(block), axis=None)
            doubtful |= bool((np.diff(ranked[ranked > ranked[-1] - 1e-5]) > 0).any())
            best = np.unravel_index(np.argmax(np.abs(block)), block.shape)
            kept = block[best]
            block[:] = 0
            block[best] = kept
    return d, doubtful


def slow_pix2nvs(s, frames):
    """Per frame: a list of (y, x, polarity, count, times or None), and whether any |d| is too near a threshold."""
    reference = slow_level(s, frames[0])
    result = []
    for n, frame in enumerate(frames[1:], 1):
        level = slow_level(s, frame)
        d, doubtful = slow_difference(s, level, reference)
        ratio = np.abs(d) / s.threshold
        doubtful |= bool((np.abs(ratio - np.round(ratio)) * s.threshold < 1e-5)[ratio > 0.5].any())
        spikes = []
        for y, x in np.ndindex(d.shape):
            count = min(s.max_events, math.floor(abs(d[y, x]) / s.threshold))
            times = [(n - 1) * DT + DT * k * s.threshold / abs(d[y, x]) for k in range(1, count + 1)]
            if count:
                spikes.append((y, x, int(d[y, x] > 0), count, times))
        alpha = s.alpha if s.exp else 1
        fired = np.abs(d) >= s.threshold
        follow = np.ones_like(fired) if s.new else fired
        reference = np.where(follow, alpha * level + (1 - alpha) * reference, reference)
        result.append((spikes, doubtful))
    return result


def clip(seed, shape, length, change):
    """Random frames in which only a part changes from one to the next, and some not at all."""
    rng = np.random.default_rng(seed)
    frame = rng.integers(0, 256, shape, dtype=np.uint8)
    frames = [frame]
    for _ in range(length - 1):
        frame = frame.copy()
        where = rng.random(shape[:2]) < rng.choice([0, change, 1], p=[0.3, 0.5, 0.2])
        frame[where] = rng.integers(0, 256, frame[where].shape, dtype=np.uint8)
        frames.append(frame)
    return frames


modes = st.builds(
    PIX2NVS,
    hue=st.booleans(),
    mode=st.sampled_from(["LI", "CE", "LICE"]),
    t_log=st.sampled_from([0.0, 1.5, 20.0]),
    continuous=st.booleans(),
    difference=st.sampled_from(["co-located", "average", "minimum"]),
    inhibition=st.sampled_from([1, 2, 3, 5]),
    threshold=st.sampled_from([0.05, 0.2, 0.4003]),
    max_events=st.sampled_from([1, 3, 50]),
    timestamps=st.sampled_from(["interpolated", "random", "linear", "fixed"]),
    new=st.booleans(),
    exp=st.booleans(),
    alpha=st.sampled_from([0.5, 0.1, 0.9]),
)


@settings(max_examples=80, deadline=None)
@given(modes, st.integers(0, 10_000), st.sampled_from([(11, 70, 3), (37, 5, 3), (17, 5)]))
def test_events_are_those_of_the_equations(s, seed, shape):
    frames = clip(seed, shape, 5, 0.1)
    pieces = list(PIX2NVS.stream(s, frames, fps=25))
    assert len(pieces) == len(frames)
    assert len(pieces[0]) == 0
    for n, (events, (spikes, doubtful)) in enumerate(zip(pieces[1:], slow_pix2nvs(s, frames), strict=True), 1):
        if doubtful:
            return  # what follows may differ, too
        found = {}
        for t, x, y, p in zip(*(column.tolist() for column in events.columns), strict=True):
            found.setdefault((y, x, p), []).append(t)
        assert {key: len(times) for key, times in found.items()} == {(y, x, p): c for y, x, p, c, _ in spikes}
        t = events.t
        assert (np.diff(t) >= 0).all()
        if s.timestamps == "interpolated":
            for y, x, p, _, times in spikes:
                np.testing.assert_allclose(found[y, x, p], times, rtol=0, atol=1)
        elif s.timestamps == "fixed":
            assert (t == n * DT).all()
        elif s.timestamps == "linear":
            expected = (n - 1) * DT + DT * np.arange(1, t.size + 1) / max(t.size, 1)
            np.testing.assert_allclose(t, expected, rtol=0, atol=1)
            order = np.lexsort((events.x, events.y))
            assert (np.diff(order) > 0).all()
        else:
            assert ((t >= (n - 1) * DT) & (t < n * DT)).all()


@settings(max_examples=60, deadline=None)
@given(modes, st.integers(0, 10_000), st.sampled_from([(20, 130, 3), (20, 136, 3), (70, 65)]))
def test_skipping_still_tiles_changes_no_bit(s, seed, shape):
    frames = clip(seed, shape, 9, 0.002)
    skipping = list(s.stream(frames, fps=25))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PIX2NVSState, "_spikes", looks_everywhere)
        plain = list(s.stream(frames, fps=25))
    assert skipping == plain


def looks_everywhere(self, frame, last, original=PIX2NVSState._spikes):
    """No tile is as it was, and none is still."""
    found = original(self, frame, last._replace(pixels=~frame.pixels))
    assert self._tiles.dirty.all()
    self._tiles.still[:] = False
    return found


def test_default_is_the_best_row_of_table_3_3():
    assert PRESETS["table-3.3-row-5"] == PIX2NVS()
    s = PIX2NVS()
    assert (s.t_log, s.inhibition, s.max_events, s.threshold, s.new, s.exp) == (0, 1, 3, 0.2, True, True)


def test_black_frames_are_no_error():
    black, white = np.zeros((8, 8), np.uint8), np.full((8, 8), 255, np.uint8)
    events = PIX2NVS().emulate([black, white, black])
    assert len(events) == 2 * 64 * 3  # ln 255 is 27 thresholds from (3.1) at q = 0
    assert (events.p[:192] == 1).all()
    assert (events.p[192:] == 0).all()


def test_sixteen_bits_float_and_bytes_agree():
    rng = np.random.default_rng(0)
    frames = [rng.integers(1, 256, (8, 70, 3), dtype=np.uint8) for _ in range(3)]
    of_bytes = PIX2NVS().emulate(frames)
    assert PIX2NVS().emulate([frame.astype(np.uint16) * 257 for frame in frames]) == of_bytes
    assert PIX2NVS().emulate([frame / 255 for frame in frames]) == of_bytes
    rgba = [np.dstack([frame, np.full(frame.shape[:2], 7, np.uint8)]) for frame in frames]
    assert PIX2NVS().emulate(rgba) == of_bytes


def test_times_of_their_own():
    frames = [np.full((4, 4), v, np.uint8) for v in (10, 100, 10)]
    start = 1_600_000_000_000_000
    events = PIX2NVS(timestamps="fixed").emulate(frames, fps=10)
    assert set(events.t.tolist()) == {100_000, 200_000}
    pieces = list(PIX2NVS(timestamps="fixed").stream(frames, times=[start, start + 7, start + 1_000_000]))
    assert [set(piece.t.tolist()) for piece in pieces] == [set(), {start + 7}, {start + 1_000_000}]


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        ({"threshold": 0}, "threshold must be at least"),
        ({"threshold": math.nan}, "threshold must be at least"),
        ({"mode": "li"}, "mode must be one of"),
        ({"difference": "mean"}, "difference must be one of"),
        ({"timestamps": "FRAME"}, "timestamps must be one of"),
        ({"alpha": 0}, "alpha must (be positive|lie between)"),
        ({"inhibition": 0}, "inhibition must be a whole number"),
        ({"max_events": 1.5}, "max_events must be a whole number"),
        ({"continuous": True, "t_log": 1}, "continuous needs t_log above 1"),
        ({"noise_rate": -1}, "noise_rate must not be negative"),
        ({"hot_pixels": 2}, "hot_pixels must be between"),
    ],
)
def test_settings_out_of_range(bad, says):
    with pytest.raises(ValueError, match=says):
        PIX2NVS(**bad)


def test_frames_that_cannot_be():
    gray = np.zeros((6, 8), np.uint8)
    with pytest.raises(ValueError, match="no frames"):
        PIX2NVS().emulate([])
    assert len(PIX2NVS().emulate([gray])) == 0
    with pytest.raises(ValueError, match="the frame at 33333 µs is 9x6"):
        PIX2NVS().emulate([gray, np.zeros((6, 9), np.uint8)])
    with pytest.raises(ValueError, match="inhibition=7 is larger"):
        PIX2NVS(inhibition=7).emulate([gray])
    with pytest.raises(ValueError, match="times must rise"):
        list(PIX2NVS().stream([gray, gray], times=[5, 5]))
    with pytest.raises(ValueError, match="fewer times than frames"):
        list(PIX2NVS().stream([gray, gray], times=[5]))
    with pytest.raises(ValueError, match="floats must be in"):
        PIX2NVS().emulate([gray + 2.0])
    with pytest.raises(ValueError, match=r"shape \(6, 8, 2\)"):
        PIX2NVS().emulate([np.zeros((6, 8, 2), np.uint8)])
    with pytest.raises(ValueError, match="int64"):
        PIX2NVS().emulate([gray.astype(np.int64)])


def test_memory_of_a_buffer_that_is_reused():
    """A camera loop may hand out one array again and again."""
    buffer = np.zeros((8, 8), np.uint8)

    def reused():
        for value in (10, 200, 10):
            buffer[:] = value
            yield buffer

    assert PIX2NVS().emulate(reused()) == PIX2NVS().emulate([np.full((8, 8), v, np.uint8) for v in (10, 200, 10)])
