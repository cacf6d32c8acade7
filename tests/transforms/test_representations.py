"""Dense representations of events against their definitions, event by event in float64."""

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events
from nvsdata import transforms as T

LATE = 1_600_000_000_000_000
few = events(max_size=60)
taus = st.sampled_from((0.5, 30.0, 50_000.0, 1e9))


def rows(ev):
    return list(zip(*(column.tolist() for column in ev.columns), strict=True))


def grid(ev, *first):
    return np.zeros((*first, ev.sensor_size[1], ev.sensor_size[0]))


def moved(ev, by):
    return Events(ev.t + by, ev.x, ev.y, ev.p, ev.sensor_size, start=ev.start + by, end=ev.end + by)


def near(ev, span):
    """The events of the first `span` µs."""
    return ev.window(ev.start, ev.start + span)


def bin_of(t, ev, bins):
    share = Fraction(t - ev.start, max(ev.end - ev.start, 1))
    return min(math.floor(share * bins), bins - 1)


def frame_numbers(ev, way):
    """The number of frames, and that of each event's."""
    (name, value), numbers = *way.items(), []
    for i, (t, *_) in enumerate(rows(ev)):
        number = {"bins": bin_of(t, ev, value), "duration": (t - ev.start) // value, "count": i // value}
        numbers.append(number[name])
    span = ev.end - ev.start
    count = {"bins": value, "duration": max(-(-span // value), 1), "count": max(-(-len(ev) // value), 1)}[name]
    return count, [min(number, count - 1) for number in numbers]


ways = st.one_of(
    st.builds(lambda n: {"bins": n}, st.integers(1, 20)),
    st.builds(lambda n: {"duration": n}, st.sampled_from((500, 1_000, 7_777, 100_000, 10**30))),
    st.builds(lambda n: {"count": n}, st.sampled_from((1, 3, 10, 1_000))),
)


@given(ev=few, way=ways, values=st.sampled_from(("count", "binary", "sum")))
def test_frames_have_each_event_once(ev, way, values):
    ev = near(ev, 100_000)
    count, numbers = frame_numbers(ev, way)
    expected = grid(ev, count, 1 if values == "sum" else 2)
    for number, (_, x, y, p) in zip(numbers, rows(ev), strict=True):
        if values == "sum":
            expected[number, 0, y, x] += 2 * p - 1
        else:
            expected[number, 1 - p, y, x] += 1
    if values == "binary":
        expected = np.minimum(expected, 1)
    if values == "sum":
        expected = expected[:, 0]
    frames = T.ToFrames(**way, values=values)(ev)
    assert frames.dtype == torch.float32
    assert np.array_equal(frames, expected)
    assert frames.equal(T.ToFrames(**way, values=values)(moved(ev, LATE)))
    if values == "count":
        assert frames.sum() == len(ev)


@pytest.mark.parametrize("values", ["count", "binary", "sum"])
@pytest.mark.parametrize("kind", ["int16", "uint8"])
def test_frames_of_whole_numbers_stay_at_the_end_of_their_range(values, kind):
    if (values, kind) == ("sum", "uint8"):
        with pytest.raises(ValueError, match="choose int16"):
            T.ToFrames(2, values=values, dtype=kind)
        return
    rng = np.random.default_rng(0)
    n = 80_000
    t = np.sort(rng.integers(0, 1_000, n))
    # most of them at one pixel, and OFF
    x, y = (np.where(rng.random(n) < 0.9, 3, rng.integers(0, 6, n)) for _ in range(2))
    ev = Events(t, x, y, rng.random(n) < 0.05, (6, 6))
    found, expected = T.ToFrames(1, values=values, dtype=kind)(ev), T.ToFrames(1, values=values)(ev)
    limits = torch.iinfo(found.dtype)
    assert str(found.dtype) == f"torch.{kind}"
    assert values == "binary" or not (limits.min <= expected.min() and expected.max() <= limits.max)
    assert torch.equal(found.float(), expected.clamp(limits.min, limits.max))


@given(ev=few, bins=st.integers(1, 9), way=st.sampled_from(("linear", "nearest")))
def test_a_voxel_grid_divides_polarity_between_bins(ev, bins, way):
    expected = grid(ev, bins)
    for t, x, y, p in rows(ev):
        at = (bins - 1) * (t - int(ev.t[0])) / max(ev.duration, 1)
        for b in range(bins):
            share = max(0, 1 - abs(b - at)) if way == "linear" else b == math.floor(at + 0.5)
            expected[b, y, x] += (2 * p - 1) * share
    found = T.VoxelGrid(bins, way)(ev)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)
    assert found.equal(T.VoxelGrid(bins, way)(moved(ev, LATE)))
    assert math.isclose(found.double().sum(), (2 * ev.p.astype(int) - 1).sum(), abs_tol=1e-4)


@given(ev=few, tau=taus, every=st.sampled_from((None, 1_000, 7_777, 60_000)))
def test_a_time_surface_knows_the_last_event_of_each_pixel(ev, tau, every):
    ev = near(ev, 150_000)
    times = [ev.end]
    if every is not None:
        count, numbers = frame_numbers(ev, {"duration": every})
        times = [*(ev.start + every * n for n in range(1, count)), ev.end]
    expected = grid(ev, len(times), 2)
    for n, time in enumerate(times):
        for i, (t, x, y, p) in enumerate(rows(ev)):
            if every is None or numbers[i] <= n:
                expected[n, 1 - p, y, x] = math.exp(-(time - t) / tau)
    found = T.TimeSurface(tau, every)(ev)
    np.testing.assert_allclose(found, expected if every else expected[0], rtol=1e-6, atol=1e-37)
    assert found.equal(T.TimeSurface(tau, every=every)(moved(ev, LATE)))


@given(ev=few, tau=taus, radius=st.integers(0, 3))
def test_event_surfaces_surround_each_event(ev, tau, radius):
    last, expected = {}, []
    for t, x, y, p in rows(ev):
        last[x, y, p] = t
        offsets = range(-radius, radius + 1)
        expected.append(
            [[math.exp(-(t - last.get((x + c, y + r, p), -math.inf)) / tau) for c in offsets] for r in offsets]
        )
    found = T.EventSurfaces(radius, tau)(ev)
    side = 2 * radius + 1
    assert found.shape == (len(ev), side, side)
    np.testing.assert_allclose(found, np.reshape(expected, found.shape), rtol=1e-6, atol=1e-37)
    assert (found[:, radius, radius] == 1).all()
    assert found.equal(T.EventSurfaces(radius, tau)(moved(ev, LATE)))


@given(ev=few, tau=taus, radius=st.integers(0, 3))
def test_event_surfaces_of_both_polarities_are_those_of_hots(ev, tau, radius):
    """Lagorce et al. 2017, eq. 2 and 3: T(u, p) is the time of the last event of each polarity p at an offset u."""
    last, expected = {}, []
    for t, x, y, p in rows(ev):
        last[x, y, p] = t
        offsets = range(-radius, radius + 1)
        expected.append(
            [
                [[math.exp(-(t - last.get((x + c, y + r, q), -math.inf)) / tau) for c in offsets] for r in offsets]
                for q in (1, 0)
            ]
        )
    found = T.EventSurfaces(radius, tau, "both")(ev)
    side = 2 * radius + 1
    assert found.shape == (len(ev), 2, side, side)
    np.testing.assert_allclose(found, np.reshape(expected, found.shape), rtol=1e-6, atol=1e-37)
    own = found[np.arange(len(ev)), 1 - ev.p.astype(int)]
    assert own.equal(T.EventSurfaces(radius, tau)(ev))
    assert found.equal(T.EventSurfaces(radius, tau, polarity="both")(moved(ev, LATE)))


@given(ev=few, tau=taus, cell=st.integers(1, 8), radius=st.integers(0, 3), window=st.sampled_from((1, 3_000, 10**6)))
def test_hats_are_those_of_the_paper(ev, tau, cell, radius, window):
    columns, lines = -(-ev.sensor_size[0] // cell), -(-ev.sensor_size[1] // cell)
    expected, counts = np.zeros((lines * columns, 2, 2 * radius + 1, 2 * radius + 1)), np.zeros(lines * columns)
    home = [y // cell * columns + x // cell for _, x, y, _ in rows(ev)]
    for i, (t, x, y, p) in enumerate(rows(ev)):
        counts[home[i]] += 1
        for j, (before, a, b, q) in enumerate(rows(ev)):
            inside = max(abs(a - x), abs(b - y)) <= radius and home[i] == home[j]
            if inside and t - window <= before < t and p == q:
                expected[home[i], 1 - p, b - y + radius, a - x + radius] += math.exp(-(t - before) / tau)
    expected /= np.maximum(counts, 1)[:, None, None, None]
    found = T.HATS(cell, radius, window, tau)(ev)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-12)
    assert found.equal(T.HATS(cell, radius, window=window, tau=tau)(moved(ev, LATE)))


@pytest.mark.parametrize("tau", [100, 300, 1000, 3000])
def test_events_that_left_the_window_leave_nothing_in_hats(tau):
    """Not even what their sum and differences round to."""
    t = [0, 1, 2, 5, 7, 11, 13, 400]
    ev = Events(t, [3] * 7 + [4], [3] * 8, [1] * 8, (10, 10))
    found = T.HATS(radius=2, window=50, tau=tau)(ev)
    # each of the first seven saw those before it, at its own pixel; the last one saw none
    assert found.nonzero().tolist() == [[0, 0, 2, 2]]


def test_long_gaps_and_crowds_in_hats():
    # sums at a pixel shrink by exp(-300) from epoch to epoch, and lose events while others come
    t = np.concatenate([np.arange(2_000), [10**5, 10**5 + 1, 10**9], 10**9 + np.arange(2_000)])
    ev = Events(t, t * 0, t * 0, t * 0 + 1, (1, 1))
    found = T.HATS(1, 0, window=50, tau=1.0)(ev)[0, 0].item()
    expected = sum(math.exp(-float(a - b)) for a in t for b in t[(t < a) & (t >= a - 50)]) / len(t)
    assert math.isclose(found, expected, rel_tol=1e-6)


@given(ev=few)
def test_four_channels_count_and_say_when(ev):
    expected = grid(ev, 4)
    for t, x, y, p in rows(ev):
        expected[1 - p, y, x] += 1
        expected[3 - p, y, x] = (t - ev.start) / max(ev.end - ev.start, 1)
    found = T.FourChannels()(ev)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert found.equal(T.FourChannels()(moved(ev, LATE)))


@given(ev=few, bins=st.integers(1, 12), most=st.sampled_from((1, 2, 10)))
def test_a_stacked_histogram_counts_in_equal_parts(ev, bins, most):
    expected = grid(ev, 2, bins)
    for t, x, y, p in rows(ev):
        expected[p, min(bins * (t - int(ev.t[0])) // max(ev.duration, 1), bins - 1), y, x] += 1
    found = T.StackedHistogram(bins, most)(ev)
    assert found.shape == (2 * bins, 34, 34)
    assert np.array_equal(found, np.minimum(expected, most).reshape(found.shape))
    assert found.equal(T.StackedHistogram(bins, most)(moved(ev, LATE)))


@given(ev=few, bins=st.integers(1, 12), most=st.sampled_from((None, 1, 3)))
def test_a_mixed_density_stack_has_ever_longer_parts(ev, bins, most):
    expected = grid(ev, bins)
    for t, x, y, p in rows(ev):
        for channel in range(bins):
            inside = Fraction(t - int(ev.t[0]), max(ev.duration, 1)) < Fraction(1, 2 ** (bins - 1 - channel))
            expected[channel, y, x] += (2 * p - 1) * (inside or channel == bins - 1)
    found = T.MixedDensityStack(bins, most)(ev)
    assert np.array_equal(found, expected if most is None else expected.clip(-most, most))
    assert found.equal(T.MixedDensityStack(bins, most)(moved(ev, LATE)))


@given(ev=few, k=st.integers(1, 4), ends=st.sampled_from(((150, 5_000_000), (0, 7_000), (1_000, 1_000))))
def test_tore_has_the_ages_of_the_latest_events(ev, k, ends):
    shortest, longest = ends
    expected = grid(ev, 2, k) + math.log(longest + 1) - math.log(shortest + 1)
    taken = {}
    for t, x, y, p in reversed(rows(ev)):
        slot = taken.get((x, y, p), 0)
        taken[x, y, p] = slot + 1
        if slot < k:
            age = min(max(ev.end - t, shortest), longest)
            expected[1 - p, slot, y, x] = math.log(age + 1) - math.log(shortest + 1)
    found = T.TORE(k, shortest, longest)(ev)
    assert found.shape == (2 * k, 34, 34)
    np.testing.assert_allclose(found, expected.reshape(found.shape), rtol=1e-6, atol=1e-6)
    assert found.equal(T.TORE(k, shortest=shortest, longest=longest)(moved(ev, LATE)))


@given(ev=few, leak=st.sampled_from((0.0, 1e-6, 1 / 50_000, 1.0)), increment=st.sampled_from((1.0, 0.25)))
def test_a_leaky_frame_falls_everywhere_between_events(ev, leak, increment):
    expected, now = grid(ev, 1), ev.start
    for t, x, y, _ in rows(ev):
        expected = np.maximum(expected - leak * (t - now), 0)
        expected[0, y, x] += increment
        now = t
    expected = np.maximum(expected - leak * (ev.end - now), 0)
    found = T.LeakyFrame(leak, increment)(ev)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    assert found.equal(T.LeakyFrame(leak, increment)(moved(ev, LATE)))
    assert found.equal(T.LeakyFrame(leak, increment)(moved(ev, -LATE)))


@given(ev=few, cuts=st.lists(st.integers(0, 60), max_size=3), late=st.sampled_from((0, LATE, -LATE)))
@pytest.mark.parametrize("transform", [T.TimeSurface(3_000), T.TORE(2, shortest=10), T.LeakyFrame(1e-4)], ids=repr)
def test_a_state_takes_events_piece_by_piece(transform, ev, cuts, late):
    ev = moved(ev, late)
    state, places = transform.state(ev.sensor_size), sorted({0, len(ev), *(min(cut, len(ev)) for cut in cuts)})
    for start, stop in pairwise(places):
        piece = ev[start:stop]
        state.update(Events(*piece.columns, ev.sensor_size))
    torch.testing.assert_close(state.tensor(), transform(ev), rtol=1e-6, atol=1e-6)
    # later, without events in between
    after = Events(*ev.columns, ev.sensor_size, start=ev.start, end=ev.end + 500)
    torch.testing.assert_close(state.tensor(ev.end + 500), transform(after), rtol=1e-6, atol=1e-6)


def test_what_a_state_refuses():
    ev = Events([10, 20], [0, 1], [0, 0], [1, 0], (5, 3))
    for transform in (T.TimeSurface(), T.TORE(), T.LeakyFrame()):
        state = transform.state((5, 3))
        assert state.tensor().shape[-2:] == (3, 5)
        state.update(ev)
        with pytest.raises(ValueError, match="events at 10 µs are earlier than the state, at 20 µs"):
            state.update(ev)
        with pytest.raises(ValueError, match="the state is at 20 µs; its earlier value at 19 µs isn't stored"):
            state.tensor(19)
        with pytest.raises(ValueError, match="events of 9x3 pixels, but the state has 5x3"):
            state.update(Events([30], [8], [2], [1], (9, 3)))
        with pytest.raises(ValueError, match="sensor_size must be"):
            transform.state((0, 3))


NO_EVENTS = Events.empty((5, 3))
SHAPES = {
    "frames": (T.ToFrames(4), (4, 2, 3, 5)),
    "frames by time": (T.ToFrames(duration=10), (1, 2, 3, 5)),
    "frames by events": (T.ToFrames(count=10, values="sum"), (1, 3, 5)),
    "voxels": (T.VoxelGrid(4), (4, 3, 5)),
    "surface": (T.TimeSurface(), (2, 3, 5)),
    "surfaces": (T.TimeSurface(every=1_000), (1, 2, 3, 5)),
    "event surfaces": (T.EventSurfaces(1), (0, 3, 3)),
    "plane flow": (T.PlaneFlow(), (0, 3)),
    "hats": (T.HATS(2, 1), (6, 2, 3, 3)),
    "four channels": (T.FourChannels(), (4, 3, 5)),
    "leaky": (T.LeakyFrame(), (1, 3, 5)),
    "stacked histogram": (T.StackedHistogram(4), (8, 3, 5)),
    "mixed density": (T.MixedDensityStack(4), (4, 3, 5)),
}


@pytest.mark.parametrize("name", SHAPES)
def test_no_events_give_zeros_of_the_usual_shape(name):
    transform, shape = SHAPES[name]
    found = transform(NO_EVENTS)
    assert found.shape == shape
    assert not found.any()


def test_a_stated_time_decides_about_frames():
    ev = Events([10, 20], [0, 0], [0, 0], [1, 0], (1, 1), start=0, end=100)
    assert T.ToFrames(10)(ev).flatten(1).tolist() == [[0, 0], [1, 0], [0, 1], *([[0, 0]] * 7)]
    assert T.ToFrames(duration=50)(ev).flatten(1).tolist() == [[1, 1], [0, 0]]
    assert T.TimeSurface(80)(ev).flatten().tolist() == pytest.approx([math.exp(-90 / 80), math.exp(-1)])


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: T.ToFrames(), "exactly one of bins, duration, count and fps must be given"),
        (lambda: T.ToFrames(3, count=4), "exactly one of bins, duration, count and fps must be given"),
        (lambda: T.ToFrames(0), "bins must be a whole number of at least 1, not 0"),
        (lambda: T.ToFrames(count=-1), "count must be a whole number of at least 1, not -1"),
        (lambda: T.ToFrames(duration=0.03), r"duration counts whole µs, not 0.03 \(0.03 s are 30000\)"),
        (lambda: T.ToFrames(3, values="mean"), "values must be one of .*, not 'mean'"),
        (lambda: T.VoxelGrid(0), "bins must be"),
        (lambda: T.VoxelGrid(2, "cubic"), "interpolation must be one of .*, not 'cubic'"),
        (lambda: T.TimeSurface(0), "tau must be positive"),
        (lambda: T.TimeSurface(every=0), "every must be positive"),
        (lambda: T.EventSurfaces(-1), "radius must be"),
        (lambda: T.EventSurfaces(polarity="other"), "polarity must be one of"),
        (lambda: T.EventSurfaces(tau=-1), "tau must be positive"),
        (lambda: T.HATS(0), "cell must be"),
        (lambda: T.HATS(window=0), "window must be positive"),
        (lambda: T.HATS(tau=0), "tau must be positive"),
        (lambda: T.StackedHistogram(0), "bins must be"),
        (lambda: T.StackedHistogram(most=0), "most must be"),
        (lambda: T.MixedDensityStack(61), "bins must be at most 60, not 61"),
        (lambda: T.MixedDensityStack(most=-1), "most must be"),
        (lambda: T.TORE(0), "k must be"),
        (lambda: T.TORE(shortest=-1), "shortest must not be negative"),
        (lambda: T.TORE(shortest=5, longest=4), "longest must be at least shortest, not 4 < 5"),
        (lambda: T.LeakyFrame(-1), "leak must not be negative"),
        (lambda: T.LeakyFrame(increment=0), "increment must be positive"),
        (
            lambda: T.ToFrames(duration=1)(Events([0, 2**61], [0, 0], [0, 0], [0, 0])),
            "2,305,843,009,213,693,952 frames",
        ),
        (lambda: T.ToFrames(2**25)(NO_EVENTS), "33,554,432 frames are more than the 16,777,216"),
        (
            lambda: T.TimeSurface(every=1)(Events([0, 2**61], [0, 0], [0, 0], [0, 0])),
            "2,305,843,009,213,693,952 frames",
        ),
    ],
)
def test_settings_out_of_range(make, reason):
    with pytest.raises(ValueError, match=reason):
        make()


@pytest.mark.parametrize("late", [0, -(10**9), 1_600_000_000_000_003])
@pytest.mark.parametrize(
    "transform", [T.TimeSurface(1_000), T.TORE(2), T.TAF(2, duration=10), T.LeakyFrame(1e-4)], ids=str
)
def test_pieces_without_events_that_state_no_time_say_nothing(transform, late):
    pieces = [Events([late + a, late + b], [1, 2], [0, 1], [1, 0], (4, 3)) for a, b in ((0, 5), (8, 30))]
    nothing = Events.empty((4, 3))
    plain, mixed = transform.state((4, 3)), transform.state((4, 3))
    for piece in pieces:
        plain.update(piece)
    for piece in (nothing, pieces[0], nothing, pieces[1], nothing):
        mixed.update(piece)
    assert torch.equal(plain.tensor(), mixed.tensor())
    assert plain.latest == mixed.latest == late + 30
    # one that states its end does
    mixed.update(Events.empty((4, 3), late + 30, late + 50))
    assert mixed.latest == late + 50
    assert torch.equal(plain.tensor(late + 50), mixed.tensor())
