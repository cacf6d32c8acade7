"""Kernels refuse events outside of their images, whatever was checked before, and arrays that don't belong together."""

import numpy as np
import pytest

from nvsdata.data.events import Columns
from nvsdata.kernels.represent import (
    corners,
    filters,
    flow,
    frames,
    hfirst,
    hots,
    latest,
    learned,
    measures,
    moves,
    patches,
    sample,
    surfaces,
)
from nvsdata.kernels.represent.inside import inside

WIDTH, HEIGHT, N = 6, 5, 5_000
SHAPE = HEIGHT, WIDTH
END = np.array([0, N])


def columns():
    rng = np.random.default_rng(0)
    x, y, p = (rng.integers(0, most, N) for most in (WIDTH, HEIGHT, 2))
    return np.arange(N), x.astype(np.int16), y.astype(np.int16), p.astype(np.uint8)


def zeros(*shape, dtype=np.float32):
    return np.zeros(shape, dtype)


def whole(*shape):
    return zeros(*shape, dtype=np.int64)


def double(*shape):
    return zeros(*shape, dtype=np.float64)


NEAR = np.zeros(5, np.int32)
LISTS = zeros(0, dtype=np.uint32)
PIECES = np.array([0, np.inf])
NEURON = hfirst.Neuron(9.0, 0.001, 9)
PADDED = 2, HEIGHT + 2, WIDTH + 2
OFFSETS = np.array([-1, 0, 1])
BY_POLARITY = {
    "counted": lambda t, x, y, p: frames.counted(x, y, p, END, zeros(1, 2, *SHAPE)),
    "counted, one channel": lambda t, x, y, p: frames.counted(x, y, p, END, zeros(1, 1, *SHAPE)),
    "counted_by_polarity": lambda t, x, y, p: frames.counted_by_polarity(x, y, p, END, zeros(2, 1, *SHAPE)),
    "marked": lambda t, x, y, p: frames.marked(x, y, p, END, zeros(1, 2, *SHAPE)),
    "spread": lambda *ev: frames.spread(*ev, True, zeros(3, *SHAPE)),
    "nearest": lambda *ev: frames.spread(*ev, False, zeros(3, *SHAPE)),
    "sum_frames": lambda t, x, y, p: frames.sum_frames(x, y, p, END, (WIDTH, HEIGHT), 2, zeros(1, 3, 3)),
    "surfaces": lambda *ev: surfaces.surfaces(*ev, np.array([N]), END, 9.0, double(2, *SHAPE), zeros(1, 2, *SHAPE)),
    "event_surfaces": lambda *ev: surfaces.event_surfaces(
        *ev, 9.0, 1, double(*PADDED), whole(*PADDED), zeros(N, 2, 3, 3)
    ),
    "sum_surfaces": lambda *ev: surfaces.sum_surfaces(
        *ev, 3, 1, 9, 9.0, double(2, *SHAPE), whole(2, *SHAPE), whole(2, *SHAPE), double(4, 2, 3, 3), whole(4)
    ),
    "counts_and_times": lambda *ev: latest.counts_and_times(*ev, 0, N, zeros(4, *SHAPE)),
    "push_times": lambda *ev: latest.push_times(*ev, whole(2, 3, *SHAPE), whole(2, *SHAPE)),
    "logarithms_of_ages": lambda *ev: latest.logarithms_of_ages(
        *ev, N, 0.0, 9.0, zeros(2, *SHAPE, dtype=np.int32), zeros(2, 3, *SHAPE)
    ),
    "queue_bins": lambda *ev: latest.queue_bins(
        *ev, 0, 9, whole(2, *SHAPE, 3), double(2, *SHAPE, 3, 2), whole(2, *SHAPE)
    ),
    "latest_ticks": lambda *ev: latest.latest_ticks(*ev, 0, 9, N, 2.0, zeros(3, 2, *SHAPE)),
    "splat": lambda *ev: learned.splat(*ev, END, PIECES, NEAR, double(2, 2), zeros(1, 2, 3, *SHAPE)),
    "splat_gradient": lambda *ev: learned.splat_gradient(*ev, END, PIECES, NEAR, zeros(1, 2, 3, *SHAPE), double(2, 2)),
    "measured": lambda *ev: measures.measured(*ev, 0, N, 0, N, -1, 2, 3, double(3, *SHAPE), zeros(*SHAPE)),
    "corners": lambda *ev: corners.corners(*ev, whole(2, *SHAPE)),
    "plane_flow": lambda *ev: flow.plane_flow(*ev, 1, 9, 5.0, 3, whole(*PADDED)),
    "spike_counts": lambda *ev: hfirst.spike_counts(
        *ev, (WIDTH, HEIGHT), zeros(2, 3, 3) + 1, NEURON, 2, 9, zeros(2, 2, 3, 3) + 1, NEURON
    ),
    "tokens": lambda *ev: measures.tokens(*ev, END, 1, zeros(1, 2, 2, 1, *SHAPE)),
}
BY_PIXEL = {
    "feature_surfaces": lambda t, x, y, p: hots.feature_surfaces(
        t, x, y, p.astype(np.int64) % 2, 99.0, 1, END[:1], double(*PADDED), zeros(1, 2, 3, 3)
    ),
    "nearest_prototypes": lambda t, x, y, p: hots.nearest_prototypes(
        t, x, y, p.astype(np.int64) % 2, 99.0, 1, zeros(4, 2, 3, 3), double(*PADDED), whole(N)
    ),
    "leak_into": lambda t, x, y, p: latest.leak_into(t, x, y, 1.0, 0.1, double(*SHAPE), whole(*SHAPE)),
    "around_events": lambda t, x, y, p: patches.around_events(
        x, y, 9, OFFSETS, OFFSETS, np.ones((3, 4), np.float32), zeros(*PADDED[1:], dtype=np.int32), zeros(N, 4)
    ),
    "not_refractory": lambda t, x, y, p: filters.not_refractory(t, x, y, 9, whole(*SHAPE)),
    "first_of_boxes": lambda t, x, y, p: filters.first_of_boxes(t, x, y, 1, 9, 2, whole(*SHAPE), whole(*SHAPE)),
    "within_rate": lambda t, x, y, p: filters.within_rate(t, x, y, 1, 9, 2, whole(*SHAPE)),
    "supported_by_neighbors": lambda t, x, y, p: filters.supported_by_neighbors(t, x, y, PADDED[1:], 9),
    "move_events": lambda *ev: moves.move_events(*ev, zeros(*SHAPE, dtype=np.uint32), LISTS, Columns.empty(N + 1)),
    "count_into": lambda t, x, y, p: filters.count_into(x, y, whole(*SHAPE)),
}
ALL = BY_POLARITY | BY_PIXEL


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize(("axis", "value"), [(1, -1), (1, WIDTH), (1, -(2**15)), (2, -1), (2, HEIGHT), (2, 2**15 - 1)])
@pytest.mark.parametrize("place", [0, 2_047, 2_048, N - 1])
def test_pixels_outside_of_the_sensor_are_refused(name, axis, value, place):
    events = columns()
    ALL[name](*events)
    events[axis][place] = value
    assert not inside(*events, WIDTH, HEIGHT)
    with pytest.raises(IndexError, match="outside of the sensor"):
        ALL[name](*events)


@pytest.mark.parametrize("name", BY_POLARITY)
@pytest.mark.parametrize("value", [2, 255])
def test_other_polarities_are_refused(name, value):
    events = columns()
    events[3][N // 2] = value
    assert not inside(*events, WIDTH, HEIGHT)
    with pytest.raises(IndexError, match="polarities other than 0 and 1"):
        ALL[name](*events)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("axis", [1, 2])
def test_columns_of_other_lengths_are_refused(name, axis):
    events = list(columns())
    events[axis] = events[axis][:-1]
    with pytest.raises((ValueError, IndexError)):
        ALL[name](*events)


@pytest.mark.parametrize("bounds", [[0, N + 1], [-1, N], [0, 3, N], [0], []])
def test_bounds_of_frames_beyond_the_events_are_refused(bounds):
    _, x, y, p = columns()
    with pytest.raises((ValueError, IndexError)):
        frames.counted(x, y, p, np.array(bounds, np.int64), zeros(1, 2, *SHAPE))


def test_shapes_that_do_not_belong_together_are_refused():
    t, x, y, p = columns()
    far = OFFSETS * -(2**63)
    scores = np.ones((3, 4), np.float32), zeros(*PADDED[1:], dtype=np.int32), zeros(N, 4)
    wrong = (
        lambda: patches.around_events(x, y, 9, far, OFFSETS, *scores),
        lambda: patches.around_events(x, y, 9, OFFSETS, 9 * OFFSETS, *scores),
        lambda: latest.push_times(t, x, y, p, whole(2, 0, *SHAPE), whole(2, *SHAPE)),
        lambda: latest.push_times(t, x, y, p, whole(2, 3, *SHAPE), whole(2, *SHAPE[::-1])),
        lambda: filters.first_of_boxes(t, x, y, 0, 9, 2, whole(*SHAPE), whole(*SHAPE)),
        lambda: filters.first_of_boxes(t, x, y, 1, 0, 2, whole(*SHAPE), whole(*SHAPE)),
        lambda: latest.latest_ticks(t, x, y, p, 0, 0, N, 2.0, zeros(3, 2, *SHAPE)),
        lambda: latest.logarithms(t, t[1:] > 0, 0.0, 9.0),
        lambda: measures.tokens(t, x, y, p, END, 0, zeros(1, 2, 2, 9, 2, 2)),
        lambda: measures.tokens(t, x, y, p, END, 2, zeros(1, 1, 2, 4, 3, 3)),
        lambda: measures.tokens(t, x, y, p, END, 2, zeros(1, 2, 1, 4, 3, 3)),
        lambda: measures.tokens(t, x, y, p, END, 2, zeros(1, 2, 2, 3, 3, 3)),
        lambda: sample.nonuniform_sample(t, x, y, 0, 1.0, 1.0, 1),
        lambda: surfaces.event_surfaces(t, x, y, p, 9.0, 9, double(*PADDED), whole(*PADDED), zeros(N, 1, 19, 19)),
        lambda: surfaces.event_surfaces(t, x, y, p, 0.0, 1, double(*PADDED), whole(*PADDED), zeros(N, 1, 3, 3)),
        lambda: learned.splat(t, x, y, p, END, np.ones(2), NEAR, double(2, 2), zeros(1, 2, 3, *SHAPE)),
        lambda: learned.splat(t, x, y, p, END, PIECES, NEAR + 2, double(2, 2), zeros(1, 2, 3, *SHAPE)),
        lambda: patches.patch_counts(x, y, p, np.zeros((3, 3), np.float32), 5),
    )
    for call in wrong:
        with pytest.raises(ValueError, match=" "):
            call()


def test_times_that_decrease_do_not_leave_the_arrays():
    t, x, y, p = columns()
    ev = t[::-1].copy(), x, y, p
    for name, call in ALL.items():
        if name in ("spread", "nearest", "splat", "splat_gradient"):
            with pytest.raises(ValueError, match="times must not decrease"):
                call(*ev)
        else:
            call(*ev)
    far = np.where(np.arange(N) % 2, np.iinfo(np.int64).max, np.iinfo(np.int64).min)
    for name in set(ALL) - {"spread", "nearest", "splat", "splat_gradient"}:
        ALL[name](far, x, y, p)
    sample.nonuniform_sample(far, x, y, 3, 1.0, 1.0, 1)
    patches.merged_pixels(far, x, y, p)


def test_times_that_end_before_they_began_are_refused():
    _, x, y, p = (column[:3] for column in columns())
    for linear in (True, False):
        for t in ([10, 11, 5], [10, 100, 5]):
            out = np.zeros((2, *SHAPE), np.float32)
            with pytest.raises(ValueError, match="times must not decrease"):
                frames.spread(np.array(t), x, y, p, linear, out)
            assert not out.any()


def test_patches_around_nodes_that_are_no_pixels_are_empty():
    _, x, y, p = columns()
    pos = np.array([[np.nan, 0], [np.inf, 0], [0, -np.inf], [1e30, -1e30], [-3e4, 3e4]], np.float32)
    assert not patches.patch_counts(x, y, p, pos, 5).any()


def test_rectangles_may_lie_anywhere():
    _, x, y, _ = columns()
    for left, width in ((-9, 12), (2, 3), (-(2**40), 2**41), (2**40, 5), (-(2**40), 5), (0, 0), (3, -1)):
        expected = (x >= left) & (x < left + width) & (y >= 1) & (y < 3)
        np.testing.assert_array_equal(filters.in_rectangle(x, y, left, 1, width, 2), expected)


@pytest.mark.parametrize("shape", [(32_770, 2), (2, 32_770)])
def test_neighbors_are_searched_on_sensors_that_int16_can_address_alone(shape):
    none = np.zeros(0, np.int64), np.zeros(0, np.int16), np.zeros(0, np.int16)
    assert filters.supported_by_neighbors(*none, shape, 9).size == 0
    # a padded sensor has at least one pixel and a border
    for wrong in (tuple(side + (side > 2) for side in shape), tuple(side - (side == 2) for side in shape)):
        with pytest.raises(ValueError, match="shapes"):
            filters.supported_by_neighbors(*none, wrong, 9)
