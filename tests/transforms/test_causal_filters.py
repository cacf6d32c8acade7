"""Samplers that look back only, against slow ones, and on streams that are cut anywhere."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsdata import Events, models
from nvsdata import transforms as T

SIZE = (13, 9)


def drawn(rng, count):
    gaps = rng.choice([0, 1, 7, 200, 5_000], count, p=[0.3, 0.3, 0.2, 0.15, 0.05])
    t = int(rng.integers(-(10**7), 10**12)) + np.cumsum(gaps)
    return Events(t, rng.integers(0, 13, count), rng.integers(0, 9, count), rng.integers(0, 2, count), SIZE)


def pauses(events, period):
    last, kept = {}, []
    for i, (t, x, y) in enumerate(zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), strict=True)):
        if (x, y) not in last or t - last[x, y] >= period:
            last[x, y] = t
            kept.append(i)
    return kept


def boxes(events, k, side, duration):
    counts, kept = {}, []
    for i, (t, x, y) in enumerate(zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), strict=True)):
        box = t // duration, x // side, y // side
        counts[box] = counts.get(box, 0) + 1
        if counts[box] <= k:
            kept.append(i)
    return kept


def buckets(events, rate, side, burst):
    """Tokens that come at a rate, `burst` of them at most; in exact fractions of the interval."""
    interval = round(1e6 / rate)
    level, since, kept = {}, {}, []
    for i, (t, x, y) in enumerate(zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), strict=True)):
        place = x // side, y // side
        # tokens times interval
        full = burst * interval
        tokens = min(level.get(place, full) + t - since.get(place, t), full)
        if tokens >= interval:
            tokens -= interval
            kept.append(i)
        level[place], since[place] = tokens, t
    return kept


CASES = [
    (T.RefractoryPeriod(150), lambda e: pauses(e, 150)),
    (T.FirstOfBoxes(2, 3, 1_000), lambda e: boxes(e, 2, 3, 1_000)),
    (T.FirstOfBoxes(), lambda e: boxes(e, 1, 4, 10_000)),
    (T.RateLimit(3_000.0, 5, 3), lambda e: buckets(e, 3_000.0, 5, 3)),
    (T.RateLimit(200), lambda e: buckets(e, 200, 4, 4)),
    (T.RateLimit(1e6, 1, 1), lambda e: buckets(e, 1e6, 1, 1)),
]


@pytest.mark.parametrize(("sampler", "slow"), CASES, ids=[repr(sampler) for sampler, _ in CASES])
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 40))
def test_a_stream_keeps_what_the_whole_keeps(sampler, slow, seed, size):
    events = drawn(np.random.default_rng(seed), 150)
    kept = slow(events)
    assert len(kept) > 0
    found = sampler(events)
    assert found == events.of(events.columns.take(np.array(kept)))
    sieve = sampler.begin((20, 30))
    pieces = [sieve(events[at : at + size]) for at in range(0, 150, size)]
    assert np.array_equal(np.concatenate([piece.t for piece in pieces]), found.t)
    assert np.array_equal(np.concatenate([piece.x for piece in pieces]), found.x)
    # another stream begins anew
    assert np.array_equal(sampler.begin(SIZE)(events).t, found.t)


def test_no_place_exceeds_the_rate_and_quiet_ones_keep_all():
    t = np.arange(0, 10**6, 10)
    busy = Events(t, np.full(t.size, 2), np.full(t.size, 3), np.zeros(t.size), SIZE)
    assert len(T.RateLimit(100)(busy)) == 100 + 3
    quiet = busy[::10_000]
    assert T.RateLimit(100)(quiet) == quiet
    assert len(T.FirstOfBoxes(3, duration=10**5)(busy)) == 30


def test_bad_settings_are_told():
    for make, reason in (
        (lambda: T.RateLimit(0), "rate must be positive"),
        (lambda: T.RateLimit(2e6), "rate must be at most 1e6"),
        (lambda: T.RateLimit(5, 0), "side"),
        (lambda: T.RateLimit(5, 1, 0), "burst"),
        (lambda: T.FirstOfBoxes(0), "k "),
        (lambda: T.FirstOfBoxes(1, 0), "side"),
        (lambda: T.FirstOfBoxes(1, 1, 0), "duration"),
    ):
        with pytest.raises(ValueError, match=reason):
            make()


def test_extreme_times_are_kept_apart():
    far = 2**62 - 1
    events = Events([-far, 0, far], [1, 1, 1], [1, 1, 1], [1, 0, 1], SIZE)
    for sampler in (
        T.RateLimit(1e-9, 1, 1),
        T.RateLimit(1e-9, 1, 1000),
        T.FirstOfBoxes(1, 1, 2**62),
        T.RefractoryPeriod(5),
    ):
        assert sampler(events).t[0] == -far
    assert len(T.RefractoryPeriod(5)(events)) == 3


def test_a_network_follows_what_passes_a_sampler():
    rng = np.random.default_rng(0)
    torch.manual_seed(0)
    network = models.RGCNN(3, channels=(4, 5, 6), clusters=((2, 2), (4, 4), (7, 7)), hidden=7).eval()
    graph, sampler = T.RadiusGraph(), T.RateLimit(400)
    live = models.stream(network, 8_000, graph, sampler)
    pieces = [drawn(rng, 300)]
    events = pieces[0]
    for at in range(0, 300, 9):
        live.feed(events[at : at + 9])
        last = int(events.t[min(at + 9, 300) - 1])
        expected = sampler(events[: at + 9]).window(last - 8_000 + 1, last + 1)
        assert len(live) == len(expected)
        with torch.no_grad():
            torch.testing.assert_close(live.scores(), network(graph(expected))[0], atol=1e-5, rtol=0)
    live.reset()
    live.feed(events)
    assert len(live) == len(expected)
    with pytest.raises(ValueError, match=r"NonUniformSample\(.*\) can't stream: causal filters can"):
        models.stream(network, sampler=T.NonUniformSample(8))
