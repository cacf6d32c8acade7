"""Transforms from events to events against their definitions, event by event."""

import re

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events
from nvsdata import transforms as T

few = events(max_size=80)
LATE = 1_600_000_000_000_000


def rows(ev):
    return list(zip(*(column.tolist() for column in ev.columns), strict=True))


def times(ev):
    return ev.start, ev.end


@given(ev=few, period=st.sampled_from((1, 100, 5_000)))
def test_a_refractory_period_follows_each_event_that_is_kept(ev, period):
    last, kept = {}, []
    for t, x, y, p in rows(ev):
        if t - last.get((x, y), -(10**18)) >= period:
            kept.append((t, x, y, p))
            last[x, y] = t
    assert rows(T.RefractoryPeriod(period)(ev)) == kept


@given(ev=few, window=st.sampled_from((1, 100, 5_000)))
def test_background_activity_has_no_company(ev, window):
    before, kept = [], []
    for t, x, y, p in rows(ev):
        if any(max(abs(a - x), abs(b - y)) == 1 and t - s <= window for s, a, b in before):
            kept.append((t, x, y, p))
        before.append((t, x, y))
    assert rows(T.BackgroundActivity(window)(ev)) == kept


def test_filters_at_both_ends_of_time():
    ev = Events([1 - 2**62, 2**62 - 1], [0, 1], [0, 0], [1, 1])
    assert T.RefractoryPeriod(1)(ev) == ev
    assert len(T.BackgroundActivity(2**70)(ev)) == 0
    near = Events([1 - 2**62, 0], [0, 1], [0, 0], [1, 1])
    assert rows(T.BackgroundActivity(2**62)(near)) == rows(near)[1:]


@given(ev=few, rate=st.sampled_from((1.0, 300.0, 10_000.0)))
def test_hot_pixels_fire_too_often(ev, rate):
    count = {}
    for _, x, y, _ in rows(ev):
        count[x, y] = count.get((x, y), 0) + 1
    seconds = max(ev.end - ev.start, 1) / 1e6
    assert rows(T.HotPixels(rate)(ev)) == [row for row in rows(ev) if count[row[1], row[2]] / seconds <= rate]


@given(ev=few)
def test_polarities_are_selected(ev):
    for polarity in (0, 1):
        assert rows(T.SelectPolarity(polarity)(ev)) == [row for row in rows(ev) if row[3] == polarity]


@given(ev=few, box=st.tuples(*[st.integers(0, 20)] * 2, *[st.integers(1, 14)] * 2))
def test_a_crop_becomes_the_sensor(ev, box):
    x, y, width, height = box
    found = T.Crop(*box)(ev)
    assert found.sensor_size == (width, height)
    assert found.start == ev.start
    inside = [(t, a - x, b - y, p) for t, a, b, p in rows(ev) if 0 <= a - x < width and 0 <= b - y < height]
    assert rows(found) == inside


@given(ev=few, size=st.integers(1, 34))
def test_squares_of_events_are_those_of_images(ev, size):
    image = T.EventImage()(ev)
    assert T.EventImage()(T.CenterCrop(size)(ev)).equal(T.CenterCrop(size)(image))
    torch.manual_seed(size)
    cut = T.RandomCrop(size)(ev)
    torch.manual_seed(size)
    assert T.EventImage()(cut).equal(T.RandomCrop(size)(image))
    # all of a list get the same square
    torch.manual_seed(size)
    assert T.RandomCrop(size)([ev, ev]) == [cut, cut]


@given(ev=few, size=st.integers(1, 60))
def test_resized_events_lie_where_they_did(ev, size):
    found = T.Resize(size)(ev)
    assert found.sensor_size == (size, size)
    assert rows(found) == [(t, x * size // 34, y * size // 34, p) for t, x, y, p in rows(ev)]
    both = T.Resize((size, 2 * size))(ev)
    assert both.sensor_size == (2 * size, size)
    assert rows(both) == [(t, x * 2 * size // 34, y * size // 34, p) for t, x, y, p in rows(ev)]


def test_a_height_and_a_width_are_given_as_in_torchvision():
    assert T.Resize((6, 9))(torch.zeros(2, 4, 5)).shape == (2, 6, 9)
    assert T.Resize([6]) == T.Resize(6)
    assert T.from_repr(repr(T.Resize([6, 9]))) == T.Resize((6, 9))
    for size in ((6, 9, 3), (), (6, 0), (6.5, 9)):
        with pytest.raises(ValueError, match="size must be"):
            T.Resize(size)


@pytest.mark.parametrize(("theirs", "ours"), [("ToFrame", "ToFrames"), ("Denoise", "BackgroundActivity")])
def test_names_of_tonic_are_answered_with_ours(theirs, ours):
    with pytest.raises(AttributeError, match=rf"no attribute '{theirs}'; it is {ours}\("):
        getattr(T, theirs)
    with pytest.raises(AttributeError, match=r"no attribute 'Anything'$"):
        T.Anything  # noqa: B018


def test_all_names_that_are_answered_exist():
    for answer in T._ELSEWHERE.values():
        assert all(hasattr(T, word) for word in re.findall(r"[A-Z]\w+", answer)), answer


@pytest.mark.parametrize(
    "transform",
    [T.RandomFlip(p=1.0), T.RandomScale(0.5, 0.9), T.RandomRotate(40), T.RandomTranslate(3), T.RandomAffine(shift=3)],
    ids=repr,
)
def test_volumes_move_as_one(transform):
    ev = Events(np.arange(200), np.arange(200) % 20, np.arange(200) // 20, np.arange(200) % 2, (40, 30))
    torch.manual_seed(2)
    one, two = transform([ev, ev])
    assert one == two != ev
    # alone, the same numbers are drawn
    torch.manual_seed(2)
    assert transform(ev) == one


def test_events_turn_scale_and_shift_as_nodes_do():
    ev = Events(range(4), [10, 20, 5, 30], [7, 5, 20, 12], [0, 1, 0, 1], (40, 30))
    graph = T.RadiusGraph()(ev)
    for change in (lambda a: T.affine(a, 0.5), lambda a: T.affine(a, degrees=30), lambda a: T.affine(a, dx=2, dy=-3)):
        moved = change(ev)
        assert np.array_equal(np.stack((moved.x, moved.y), 1), np.rint(change(graph).pos.numpy()))


@given(ev=few)
def test_events_are_shifted_to_the_middle(ev):
    found = T.Center()(ev)
    assert (found.sensor_size, found.t.tolist(), found.p.tolist()) == (ev.sensor_size, ev.t.tolist(), ev.p.tolist())
    for before, after, size in zip((ev.x, ev.y), (found.x, found.y), ev.sensor_size, strict=True):
        assert len({*(after - before).tolist()}) <= 1
        if len(ev):
            assert 0 <= size - 1 - int(after.min()) - int(after.max()) <= 1


def test_events_of_a_list_are_shifted_alike():
    parts = [Events([0], [0], [0], [1], (9, 9)), Events([], [], [], [], (9, 9)), Events([5], [4], [2], [1], (9, 9))]
    found = T.Center()(parts)
    assert [(part.x.tolist(), part.y.tolist()) for part in found] == [([2], [3]), ([], []), ([6], [5])]


def test_scaled_random_crops_of_events():
    ev = Events([0, 1, 2], [0, 10, 19], [0, 5, 9], [1, 0, 1], (20, 10))
    found = T.RandomCrop(5, (2.0,))(ev)
    assert found.sensor_size == (5, 5)
    assert len(found) > 0
    assert T.Resize(5)(ev).sensor_size == (10, 5)


@given(ev=few, factor=st.sampled_from((1, 2, 3, 34, 100_000)), step=st.sampled_from((1, 10, 1_000)))
def test_downsampling_loses_no_event(ev, factor, step):
    found = T.Downsample(factor, step)(ev)
    side = -(-34 // factor)
    assert found.sensor_size == (side, side)
    start = ev.start
    assert rows(found) == [(start + (t - start) // step * step, x // factor, y // factor, p) for t, x, y, p in rows(ev)]


@given(ev=few)
def test_relative_time_begins_at_0(ev):
    late = Events(ev.t + LATE, ev.x, ev.y, ev.p, ev.sensor_size, start=ev.start + LATE, end=ev.end + LATE)
    found = T.RelativeTime()(late)
    assert times(found) == (0, ev.end - ev.start)
    assert rows(found) == [(t - ev.start, *row) for t, *row in rows(ev)]


@given(ev=few, factor=st.sampled_from((0.5, 1.0, 3.7)))
def test_time_is_scaled_from_the_beginning(ev, factor):
    found = T.RandomTimeScale(factor, factor)(ev)
    assert rows(found) == [(ev.start + round((t - ev.start) * factor), *row) for t, *row in rows(ev)]
    assert times(found) == (ev.start, ev.start + round((ev.end - ev.start) * factor))


@given(ev=few)
def test_time_runs_backwards(ev):
    found = T.RandomTimeFlip(1.0)(ev)
    assert rows(found) == [(ev.start + ev.end - t, x, y, 1 - p) for t, x, y, p in reversed(rows(ev))]
    assert times(found) == times(ev)
    assert T.RandomTimeFlip(1.0)(found) == ev
    assert T.RandomTimeFlip(0.0)(ev) == ev


def volumes():
    ev = Events(np.arange(40) * 10, np.arange(40) % 7, np.arange(40) % 5, np.arange(40) % 2, (7, 5))
    return [ev.window(0, 100), ev.window(150, 250), ev.window(300, 400)]


def test_volumes_run_backwards_as_one():
    parts = volumes()
    found = T.RandomTimeFlip(1.0)(parts)
    about = parts[0].start + parts[-1].end
    assert [times(part) for part in found] == [(about - part.end, about - part.start) for part in parts[::-1]]
    assert rows(found[0]) == [(about - t, x, y, 1 - p) for t, x, y, p in reversed(rows(parts[-1]))]
    assert T.RandomTimeFlip(1.0)([]) == []


def test_volumes_are_stretched_as_one():
    torch.manual_seed(1)
    parts = volumes()
    found = T.RandomTimeScale(0.5, 2.0)(parts)
    factor = found[2].start / parts[2].start
    assert 0.5 <= factor < 2
    assert factor != 1
    for before, after in zip(parts, found, strict=True):
        assert after.t.tolist() == pytest.approx((before.t * factor).tolist(), abs=2)


@pytest.mark.parametrize("sigma", [0.0, 1.0, 300.0])
def test_times_jitter_by_a_normal_distribution(sigma):
    n = 20_000
    ev = Events(np.arange(n) * 1_000, np.arange(n) % 30_000, *[np.zeros(n, int)] * 2, start=-(10**6), end=10**9)
    torch.manual_seed(0)
    found = T.TimeJitter(sigma)(ev)
    assert (np.diff(found.t) >= 0).all()
    assert sorted(found.x.tolist()) == ev.x.tolist()
    moves = found.t - found.x.astype(int) * 1_000
    assert abs(moves.mean()) < 0.03 * sigma + 1e-9
    assert moves.std() == pytest.approx((sigma**2 + (1 / 12 if sigma else 0)) ** 0.5, rel=0.02)
    assert times(found) == times(ev)


def test_jitter_leaves_the_time_at_neither_end():
    ev = Events([0, 5, 9], [0, 1, 2], [0, 0, 0], [1, 1, 0])
    found = T.TimeJitter(1_000)(ev)
    assert found.t.min() >= 0
    assert found.t.max() <= 9


def test_pixels_jitter_by_a_normal_distribution():
    n = 20_000
    ev = Events(np.arange(n), np.full(n, 50), np.full(n, 40), np.zeros(n, int), (100, 80))
    torch.manual_seed(0)
    found = T.SpatialJitter(2.0)(ev)
    assert len(found) == n
    for column, center in ((found.x, 50), (found.y, 40)):
        assert column.mean() == pytest.approx(center, abs=0.06)
        assert column.std() == pytest.approx((4 + 1 / 12) ** 0.5, rel=0.02)
    assert abs(np.corrcoef(found.x, found.y)[0, 1]) < 0.03
    # at the border half of them leave
    edge = Events(np.arange(n), np.zeros(n, int), np.full(n, 40), np.zeros(n, int), (100, 80))
    assert len(T.SpatialJitter(5.0)(edge)) == pytest.approx(n * (0.5 + 0.04), rel=0.03)


@given(ev=few, count=st.integers(0, 50))
def test_noise_comes_on_top(ev, count):
    found = T.UniformNoise(count)(ev)
    assert len(found) == len(ev) + count
    assert times(found) == times(ev)
    left = rows(found)
    assert left == sorted(left, key=lambda row: row[0])
    for row in rows(ev):
        left.remove(row)
    assert all(ev.start <= t <= ev.end and 0 <= x < 34 and 0 <= y < 34 and p in (0, 1) for t, x, y, p in left)


def test_noise_is_everywhere():
    ev = Events.empty((4, 3), 10, 19)
    torch.manual_seed(0)
    noise = T.UniformNoise(24_000)(ev)
    counts = T.ToFrames(10)(noise)
    # 240 cells of 100 events each, give or take 10
    assert counts.shape == (10, 2, 3, 4)
    assert counts.sum() == 24_000
    # frames are a tenth of 9 µs, so the last one has two moments and the first nine have what is left
    for column, values in ((noise.t, range(10, 20)), (noise.x, range(4)), (noise.y, range(3)), (noise.p, range(2))):
        share = [np.mean(column == value) for value in values]
        assert share == pytest.approx([1 / len(values)] * len(values), abs=0.012)


def test_an_interval_is_dropped():
    n = 1_000
    ev = Events(np.arange(n), *[np.zeros(n, int)] * 3)
    torch.manual_seed(0)
    begins = []
    for _ in range(300):
        gone = np.setdiff1d(np.arange(n), T.DropByTime(0.3)(ev).t)
        assert gone.tolist() == list(range(gone[0], gone[0] + 300))
        begins.append(gone[0])
    assert min(begins) < 30
    assert max(begins) > 670
    assert T.DropByTime(0.0)(ev) == ev
    assert len(T.DropByTime(1.0)(ev)) == 0


def test_an_interval_of_all_volumes_is_dropped():
    parts = volumes()
    torch.manual_seed(0)
    for _ in range(20):
        found = T.DropByTime(0.25)(parts)
        gone = sorted({t for part in parts for t in part.t.tolist()} - {t for part in found for t in part.t.tolist()})
        assert not gone or gone[-1] - gone[0] <= 100
    assert T.DropByTime()([]) == []


def test_a_rectangle_is_dropped():
    grid = np.indices((20, 30)).reshape(2, -1)
    ev = Events(np.arange(600), grid[1], grid[0], np.zeros(600, int), (30, 20))
    torch.manual_seed(0)
    corners = set()
    for _ in range(300):
        one, two = T.DropByArea(0.25)([ev, ev])
        assert one == two
        gone = {(x, y) for _, x, y, _ in rows(ev)} - {(x, y) for _, x, y, _ in rows(one)}
        (left, top), (right, bottom) = map(min, zip(*gone, strict=True)), map(max, zip(*gone, strict=True))
        assert (right - left + 1, bottom - top + 1, len(gone)) == (15, 10, 150)
        corners.add((left, top))
    assert len(corners) > 100
    assert {0, 15} <= {left for left, _ in corners}
    assert {0, 10} <= {top for _, top in corners}
    assert T.DropByArea(0.0)(ev) == ev


def test_a_run_of_events():
    ev = Events(np.arange(10), *[np.zeros(10, int)] * 3)
    torch.manual_seed(0)
    found = [T.RandomRun(4)(ev).t.tolist() for _ in range(200)]
    assert {run[0] for run in found} == set(range(7))
    assert all(run == list(range(run[0], run[0] + 4)) for run in found)
    assert T.RandomRun(10)(ev) == ev
    assert T.RandomRun(11)(ev) == ev


def test_transforms_are_applied_at_random():
    ev = volumes()[0]
    torch.manual_seed(0)
    off = T.SelectPolarity(0)
    some = [T.RandomApply(off, 0.3)(ev) == ev for _ in range(1_000)]
    assert np.mean(some) == pytest.approx(0.7, abs=0.05)
    three = T.RandomChoice([off, T.SelectPolarity(1), T.RelativeTime()])
    found = [three(ev) for _ in range(900)]
    for one in (off(ev), T.SelectPolarity(1)(ev), ev):
        assert sum(result == one for result in found) == pytest.approx(300, abs=60)
    assert T.from_repr(repr(three)) == three


@pytest.mark.parametrize(
    "transform",
    [
        *(
            T.RefractoryPeriod(5),
            T.BackgroundActivity(),
            T.Corners(),
            T.HotPixels(),
            T.SelectPolarity(),
            T.Crop(0, 0, 2, 3),
        ),
        *(T.Downsample(), T.RelativeTime(), T.TimeJitter(), T.SpatialJitter(), T.CenterCrop(2), T.Resize(4)),
    ],
    ids=repr,
)
def test_lists_and_no_events(transform):
    empty = Events.empty((7, 5), 3, 9)
    assert len(transform(empty)) == 0
    torch.manual_seed(0)
    found = transform([*volumes(), empty])
    assert [type(part) for part in found] == [Events] * 4
    with pytest.raises(TypeError, match=r"sample must be .*Events.*, not int"):
        transform(3)


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: T.RefractoryPeriod(0), "period must be positive"),
        (lambda: T.BackgroundActivity(0.01), "window counts whole µs"),
        (lambda: T.HotPixels(0), "rate must be positive"),
        (lambda: T.SelectPolarity(2), "polarity must be 0 or 1, not 2"),
        (lambda: T.Crop(-1, 0, 2, 2), "x must be a whole number of at least 0, not -1"),
        (lambda: T.Crop(0, 0, 0, 2), "width must be a whole number of at least 1, not 0"),
        (lambda: T.Crop(3, 0, 5, 5)(volumes()[0]), r"a sensor of 7x5 has no 5x5 pixels from \(3, 0\) on"),
        (lambda: T.CenterCrop(6)(volumes()[0]), "an image of 7x5 contains no square of 6"),
        (lambda: T.Downsample(0), "factor must be"),
        (lambda: T.Downsample(2, 0), "step must be"),
        (lambda: T.RandomTimeScale(0), "low must be positive"),
        (lambda: T.RandomTimeScale(2, 1), "high must be at least low"),
        (
            lambda: T.RandomTimeScale(3.0, 3.0)(Events([0, 2**61], [0, 0], [0, 0], [0, 0])),
            "µs after scaling by 3.0",
        ),
        (lambda: T.RandomTimeFlip(2), "p must be between 0 and 1"),
        (lambda: T.TimeJitter(-1), "sigma must not be negative"),
        (lambda: T.SpatialJitter(-1), "sigma must not be negative"),
        (lambda: T.UniformNoise(-1), "count must be"),
        (lambda: T.DropByTime(2), "fraction must be between 0 and 1"),
        (lambda: T.DropByArea(-1), "fraction must be between 0 and 1"),
        (lambda: T.RandomRun(0), "count must be"),
        (lambda: T.RandomApply(T.Age(), 2), "p must be between 0 and 1"),
        (lambda: T.RandomChoice([]), "at least one transform"),
    ],
)
def test_settings_out_of_range(make, reason):
    with pytest.raises(ValueError, match=reason):
        make()


def test_what_is_applied_must_be_callable():
    with pytest.raises(TypeError, match="must be callable, not 3"):
        T.RandomApply(3)
    with pytest.raises(TypeError, match="must be callable, not 3"):
        T.RandomChoice([T.Age(), 3])
