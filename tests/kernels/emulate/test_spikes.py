import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsdata.kernels.emulate.frames import TILE, read_keys, read_out
from nvsdata.kernels.emulate.pix2nvs import CO_LOCATED, INTERPOLATED, Pixels, Rule, Tiles, step


def columns(size):
    return np.empty(size, np.int64), *np.empty((2, size), np.int16), np.empty(size, np.uint8)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 32), st.integers(0, 3_000), st.integers(0, 99), st.integers(-(2**62), 2**62))
def test_keys_are_sorted_by_time_and_equal_times_keep_their_order(bits, count, seed, start):
    rng = np.random.default_rng(seed)
    times = rng.integers(0, 1 << bits, count)
    y, x, p = rng.integers(0, 1 << 15, count), rng.integers(0, 1 << 15, count), rng.integers(0, 2, count)
    keys = (times.astype(np.uint64) << np.uint64(32)) | (y << 17 | x << 1 | p).astype(np.uint64)
    order = np.argsort(times, kind="stable")
    found = columns(count)
    read_keys(keys.copy(), bits, start, *found)
    for column, expected in zip(found, (times + start, x, y, p), strict=True):
        assert (column == expected[order]).all()


def test_columns_of_another_length_are_refused():
    t, x, y, p = columns(3)
    keys = np.zeros(3, np.uint64)
    for wrong in ((t[:2], x, y, p), (t, x[:2], y, p), (t, x, y[:2], p), (t, x, y, p[:2])):
        with pytest.raises(ValueError, match="as long as keys"):
            read_keys(keys, 4, 0, *wrong)
    with pytest.raises(ValueError, match="0 to 32 bits"):
        read_keys(keys, 33, 0, t, x, y, p)


def fire(difference, active, threshold, most, span, keys):
    """What a frame gives whose levels differ by as much from references of 0."""
    number = difference.dtype.type
    none = np.empty((0, 0), number)
    rule = Rule(False, none.ravel(), 0, 1, CO_LOCATED, none, 1, threshold, most, INTERPOLATED, 1, True, threshold)
    dirty, still = np.zeros((2, *active.shape), bool)
    tiles = Tiles(dirty, dirty, active, still, np.zeros(active.shape, np.int64))
    pixels = Pixels(difference, difference, np.zeros_like(difference), np.empty_like(difference))
    frame = np.zeros((0, difference.shape[1]), np.uint8)
    return step(frame, frame, 299, rule, tiles, pixels, span, 0, keys)


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(st.integers(1, 20), st.integers(1, 150)),
    st.sampled_from([0.0, 0.02, 0.5, 1.0]),
    st.sampled_from([1, 3, 4, 1_000, 2**40]),
    st.sampled_from([np.float32, np.float64]),
    st.sampled_from([0, 1, 5, 20_000]),
    st.integers(0, 99),
)
def test_what_fires_is_what_reaches_the_threshold(shape, share, most, number, room, seed):
    rng = np.random.default_rng(seed)
    difference = np.where(rng.random(shape) < share, rng.normal(0, 3, shape), rng.uniform(-0.4, 0.4, shape))
    difference = difference.astype(number)
    active = rng.random((-(-shape[0] // TILE[0]), -(-shape[1] // TILE[1]))) < 0.8
    span = 40_000
    keys, n = fire(difference, active, number(0.5), most, span, np.empty(room, np.uint64))
    expected = []
    for y, x in np.ndindex(shape):
        d = abs(float(difference[y, x]))
        if active[y // TILE[0], x // TILE[1]] and d >= 0.5:
            for k in range(1, min(int(d / 0.5), most) + 1):
                expected.append((y, x, difference[y, x] > 0, k * span * 0.5 / d))
    found = keys[:n]
    assert [(k >> 17 & 0x7FFF, k >> 1 & 0xFFFF, k & 1) for k in found.tolist()] == [e[:3] for e in expected]
    np.testing.assert_allclose(found >> np.uint64(32), [e[3] for e in expected], rtol=0, atol=0.51)


@pytest.mark.parametrize("span", [1, 2**21, 2**21 + 1, 2**31 - 1])
@pytest.mark.parametrize("number", [np.float32, np.float64])
def test_times_stay_within_the_span_for_any_difference(number, span):
    largest = np.finfo(number).max
    difference = np.array([[0.5, 0.75, 1, 1e6, largest, -largest, np.inf, -np.inf, np.nan]], number)
    keys, n = fire(difference, np.ones((1, 1), bool), number(0.5), 3, span, np.empty(0, np.uint64))
    assert n == 1 + 1 + 2 + 5 * 3
    assert int((keys[:n] >> np.uint64(32)).max()) <= span
    assert (keys[0] >> np.uint64(32)) == span


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 300), st.integers(0, 99), st.sampled_from([0.0, 0.1, 3.7]), st.sampled_from([0, 40]))
def test_readout_is_what_a_slow_loop_gives(count, seed, gap, refractory):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(-50, 500, count))
    x, y = rng.integers(0, 5, (2, count)).astype(np.int16)
    ready, start, busy = np.full(25, -(2**62)), -20, 7.5
    expected, slow_ready, slow_busy = [], ready.copy(), busy
    for i in range(count):
        if t[i] < slow_ready[y[i] * 5 + x[i]]:
            expected.append(None)
            continue
        free = max(float(t[i] - start), slow_busy)
        slow_busy = free + gap
        expected.append(start + int(np.ceil(free)))
        slow_ready[y[i] * 5 + x[i]] = max(expected[-1], t[i]) + refractory
    out, kept, busy = read_out(t, x, y, 5, ready, refractory, gap, busy, start)
    assert busy == slow_busy
    assert (ready == slow_ready).all()
    assert [int(time) if k else None for time, k in zip(out, kept, strict=True)] == expected


OUTSIDE = [(5, 4, 5), (0, 5, 5), (-1, 0, 5), (0, -1, 5), (-3, -2, 5), (0, 1, 2**62), (0, 2, 2**63 - 1)]


@pytest.mark.parametrize(("x", "y", "width"), OUTSIDE)
def test_events_outside_the_sensor_are_refused(x, y, width):
    with pytest.raises(IndexError, match="outside the sensor"):
        read_out(np.zeros(1, np.int64), np.int16([x]), np.int16([y]), width, np.zeros(25, np.int64), 0, 0.0, 0.0, 0)


def test_columns_of_a_readout_are_equally_long():
    t, x = np.zeros(2, np.int64), np.zeros(2, np.int16)
    for columns in ((t, x, x[1:]), (t, x[1:], x), (t[1:], x, x)):
        with pytest.raises(ValueError, match="columns differ in length"):
            read_out(*columns, 5, np.zeros(25, np.int64), 0, 0.0, 0.0, 0)


@pytest.mark.parametrize("busy", [2.0**63, np.inf, np.nan])
def test_a_readout_that_never_gets_there_is_refused(busy):
    columns = np.zeros(1, np.int64), *np.zeros((2, 1), np.int16)
    if np.isnan(busy):
        read_out(*columns, 5, np.zeros(25, np.int64), 0, 0.0, busy, 0)
    else:
        with pytest.raises(IndexError, match="too far behind"):
            read_out(*columns, 5, np.zeros(25, np.int64), 0, 0.0, busy, 0)
