"""Representations of published networks against their definitions, written out in float64."""

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import events
from test_representations import LATE, few, grid, moved, rows

from nvsdata import Events
from nvsdata import transforms as T


@given(ev=few, parts=st.integers(1, 5), patch=st.integers(1, 5))
def test_group_tokens_count_and_time_the_pixels_of_patches(ev, parts, patch):
    height, width = -(-34 // patch), -(-34 // patch)
    expected = np.zeros((parts, 2, 2, patch * patch, height, width))
    for t, x, y, p in rows(ev):
        gap = t - int(ev.t[0])
        part = parts * gap // (ev.duration + 1)
        place = part, p, slice(None), y % patch * patch + x % patch, y // patch, x // patch
        expected[place] += 1, gap / max(ev.duration, 1)
    found = T.GroupTokens(2 * parts, patch)(ev)
    assert found.shape == (4 * parts * patch * patch, height, width)
    np.testing.assert_allclose(found, expected.reshape(found.shape), rtol=1e-5)
    assert found.equal(T.GroupTokens(2 * parts, patch)(moved(ev, LATE)))
    assert found.view(parts, 2, 2, -1)[:, :, 0].sum() == len(ev)


def ergo(ev):
    """ERGO-12 by its list of measures, pixel by pixel."""
    n = len(ev)
    shares = [(t - int(ev.t[0])) / max(ev.duration, 1) for t, *_ in rows(ev)]
    halves = [n // 2, n // 2 + n // 2 // 2, n // 2 + n // 2 // 2 + n // 2 // 2 // 2]
    parts = [(0, n), (0, n // 3), (n // 3, 2 * (n // 3)), (2 * (n // 3), 3 * (n // 3)), *((half, n) for half in halves)]
    channels = [
        (0, "any", "polarity", np.var),
        (3, "off", "time", np.var),
        (2, "off", "one", np.mean),
        (6, "any", "polarity", np.sum),
        (5, "on", "one", np.mean),
        (6, "any", "one", np.sum),
        (2, "on", "time", np.mean),
        (5, "off", "one", np.mean),
        (1, "off", "time", np.max),
        (0, "on", "time", np.max),
        (4, "any", "time", np.max),
        (1, "any", "one", np.mean),
    ]
    out = grid(ev, 12)
    for plane, (part, which, what, measure) in zip(out, channels, strict=True):
        found = {}
        for (_, x, y, p), share in list(zip(rows(ev), shares, strict=True))[slice(*parts[part])]:
            if which in ("any", "on" if p else "off"):
                found.setdefault((y, x), []).append({"polarity": 2 * p - 1, "time": share, "one": 1}[what])
        for pixel, values in found.items():
            plane[pixel] = measure(values)
    return out


@given(ev=events(max_size=120, width=4, height=3))
def test_ergo_has_twelve_measures(ev):
    found = T.ERGO12()(ev)
    np.testing.assert_allclose(found, ergo(ev), rtol=1e-5, atol=1e-6)
    assert found.equal(T.ERGO12()(moved(ev, LATE)))


def taf(ev, depth, duration):
    """Temporal active focus at the end of a whole number of bins, bin by bin as in the authors' code."""
    bins = (ev.end - ev.start) // duration
    queue = grid(ev, depth, 2) - 1e9
    for number in range(bins):
        counts, sums = grid(ev, 2), grid(ev, 2)
        for t, x, y, p in rows(ev):
            if (t - ev.start) // duration == number:
                counts[p, y, x] += 1
                sums[p, y, x] += (t - ev.start) / duration - number - 1
        queue -= 1
        some = counts > 0
        queue[:-1, some] = queue[1:, some]
        queue[-1, some] = sums[some] / counts[some]
    return np.maximum(1 - np.log1p(-queue) / 8.7, 0).reshape(2 * depth, *queue.shape[2:])


@given(ev=events(max_size=60, width=5, height=4), depth=st.integers(1, 4), duration=st.sampled_from((300, 5_000)))
def test_taf_keeps_the_latest_bins_with_events(ev, depth, duration):
    start = int(ev.t[0]) if len(ev) else 0
    bins = (ev.end - start) // duration + 1
    if bins > 200:
        return
    ev = Events(*ev.columns, ev.sensor_size, start=start, end=start + bins * duration)
    found = T.TAF(depth, duration)(ev)
    np.testing.assert_allclose(found, taf(ev, depth, duration), rtol=1e-5, atol=1e-6)
    assert found.equal(T.TAF(depth, duration)(moved(ev, LATE)))


@given(ev=few, cuts=st.lists(st.integers(0, 60), max_size=3), late=st.sampled_from((0, LATE, -LATE)))
def test_a_queue_takes_events_piece_by_piece(ev, cuts, late):
    ev = moved(ev, late)
    transform = T.TAF(3, 700)
    state = transform.state(ev.sensor_size)
    for start, stop in pairwise(sorted({0, len(ev), *(min(cut, len(ev)) for cut in cuts)})):
        state.update(Events(*ev[start:stop].columns, ev.sensor_size, start=ev.start))
    assert state.tensor(ev.end + 500).equal(
        transform(Events(*ev.columns, ev.sensor_size, start=ev.start, end=ev.end + 500))
    )


def left(ev, k, tick, decay):
    """Potentials of filter k, one tick after the other."""
    potential = grid(ev, 2)
    for now in range((ev.end - ev.start) // tick + 2):
        potential = np.maximum(potential - Fraction(1) / Fraction(decay), 0)
        for t, x, y, p in rows(ev):
            if (t - ev.start) // tick == now - k:
                potential[1 - p, y, x] = 1
    return potential


@given(
    ev=events(max_size=40, width=4, height=3, gap=400),
    filters=st.integers(1, 4),
    decay=st.sampled_from((1, 2.5, 8)),
    tick=st.sampled_from((700, 3_000)),
)
def test_a_cascade_delays_and_decays(ev, filters, decay, tick):
    expected = np.concatenate([left(ev, k, tick, decay) for k in range(1, filters + 1)]).astype(float)
    if decay == 1:
        found = T.FilterCascade(filters, tick)(ev)
        assert np.array_equal(found, expected)
        assert found.equal(T.FilterCascade(filters, tick)(moved(ev, LATE)))
        return
    draws = torch.stack([T.FilterCascade(filters, tick, decay)(ev) for _ in range(60)])
    assert set(draws.unique().tolist()) <= {0, 1}
    # what is certain is so always; the rest on average, within 5 standard errors
    assert (draws[:, expected == 1] == 1).all()
    assert not draws[:, expected == 0].any()
    some = (expected > 0) & (expected < 1)
    if some.any():
        error = math.sqrt((expected[some] * (1 - expected[some])).sum() / 60) / some.sum()
        assert abs(draws[:, some].mean() - expected[some].mean()) < 5 * error


def on_the_grid(transform, dx, dy):
    """What an event at an offset adds to the rings and wedges, [rings, wedges]."""
    out, radius = np.zeros((transform.rings, transform.wedges)), math.hypot(dx, dy)
    if radius > transform.furthest:
        return out
    steps = [
        transform.nearest * (transform.furthest / transform.nearest) ** (n / (transform.rings - 1))
        for n in range(transform.rings)
    ]
    for ring, step in enumerate(steps):
        apart = abs(math.log(max(radius, transform.nearest) / step)) / math.log(steps[1] / steps[0])
        for wedge in range(transform.wedges):
            turn = math.atan2(dy, dx) / (2 * math.pi) * transform.wedges - wedge
            turn = abs((turn + transform.wedges / 2) % transform.wedges - transform.wedges / 2)
            out[ring, wedge] += max(1 - apart, 0) * max(1 - turn, 0)
    return out


@given(
    ev=events(max_size=40, width=20, height=16),
    rings=st.integers(2, 4),
    wedges=st.sampled_from((3, 4, 7)),
    radii=st.sampled_from(((1.0, 5.0), (0.5, 2.5), (2.0, 9.3))),
    queue=st.sampled_from((1, 7, 2_000)),
)
def test_dart_has_the_recent_events_around_each(ev, rings, wedges, radii, queue):
    transform = T.DART(rings, wedges, *radii, queue)
    found = transform(ev)
    assert found.shape == (len(ev), rings * wedges)
    places = [(x, y) for _, x, y, _ in rows(ev)]
    for i, (x, y) in enumerate(places):
        recent = places[max(i + 1 - queue, 0) : i + 1]
        expected = sum(on_the_grid(transform, a - x, b - y) for a, b in recent)
        np.testing.assert_allclose(found[i].view(rings, wedges), expected / expected.sum(), rtol=1e-4, atol=1e-6)
    if len(ev) and queue == 2_000:
        assert T.DART()(ev).equal(T.DART()(moved(ev, LATE)))


NO_EVENTS = Events.empty((5, 3))


@pytest.mark.parametrize(
    ("transform", "shape"),
    [
        (T.GroupTokens(4, 2), (32, 2, 3)),
        (T.ERGO12(), (12, 3, 5)),
        (T.TAF(4), (8, 3, 5)),
        (T.FilterCascade(3, decay=4.0), (6, 3, 5)),
        (T.DART(3, 4), (0, 12)),
    ],
    ids=repr,
)
def test_no_events_give_zeros_of_the_usual_shape(transform, shape):
    found = transform(NO_EVENTS)
    assert found.shape == shape
    assert found.dtype == torch.float32
    assert not found.any()


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: T.GroupTokens(0), "groups must be"),
        (lambda: T.GroupTokens(5), "groups must be even, not 5"),
        (lambda: T.GroupTokens(patch=0), "patch must be"),
        (lambda: T.TAF(0), "depth must be"),
        (lambda: T.TAF(duration=0.5), "duration counts whole µs"),
        (lambda: T.FilterCascade(0), "filters must be"),
        (lambda: T.FilterCascade(tick=0), "tick must be positive"),
        (lambda: T.FilterCascade(decay=0.5), "decay must be at least 1, not 0.5"),
        (lambda: T.DART(1), "rings must be"),
        (lambda: T.DART(nearest=5, furthest=5), "furthest must be more than nearest, not 5 <= 5"),
        (lambda: T.DART(queue=0), "queue must be"),
        (lambda: T.RandomPolarityFlip(2), "p must be between 0 and 1"),
    ],
)
def test_settings_out_of_range(make, reason):
    with pytest.raises(ValueError, match=reason):
        make()


def test_polarities_merge_and_flip():
    ev = Events([1, 2, 3], [0, 1, 2], [0, 0, 1], [1, 0, 1], (4, 2), start=0, end=9)
    merged, flipped = T.MergePolarities()(ev), T.RandomPolarityFlip(1.0)(ev)
    assert merged.p.tolist() == [1, 1, 1]
    assert flipped.p.tolist() == [0, 1, 0]
    for changed in (merged, flipped):
        assert np.array_equal(changed.t, ev.t)
        assert np.array_equal(changed.x, ev.x)
        assert (changed.start, changed.end, changed.sensor_size) == (0, 9, (4, 2))
    assert [part.p.tolist() for part in T.RandomPolarityFlip(1)([ev, merged])] == [[0, 1, 0], [0, 0, 0]]
