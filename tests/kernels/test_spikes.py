import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsdata.kernels.spikes import INTERPOLATED, fire, sort_keys
from nvsdata.kernels.tiles import TILE


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 31), st.integers(0, 3_000), st.integers(0, 99))
def test_keys_are_sorted_by_time_and_equal_times_keep_their_order(bits, count, seed):
    rng = np.random.default_rng(seed)
    times = rng.integers(0, 1 << bits, count).astype(np.uint64)
    keys = times << np.uint64(32) | rng.integers(0, 1 << 32, count).astype(np.uint64)
    expected = keys[np.argsort(times, kind="stable")]
    sort_keys(keys, np.empty_like(keys), bits)
    assert (keys == expected).all()


@settings(max_examples=40, deadline=None)
@given(
    st.tuples(st.integers(1, 20), st.integers(1, 150)),
    st.sampled_from([0.0, 0.02, 0.5, 1.0]),
    st.sampled_from([1, 3, 4, 1_000, 2**40]),
    st.sampled_from([np.float32, np.float64]),
    st.integers(0, 99),
)
def test_what_fires_is_what_reaches_the_threshold(shape, share, most, number, seed):
    rng = np.random.default_rng(seed)
    difference = np.where(rng.random(shape) < share, rng.normal(0, 3, shape), rng.uniform(-0.4, 0.4, shape))
    difference = difference.astype(number)
    active = rng.random((-(-shape[0] // TILE[0]), -(-shape[1] // TILE[1]))) < 0.8
    top, span, room = 16, 40_000, 5
    earlier = np.arange(3, dtype=np.uint64)
    keys = np.concatenate((earlier, np.empty(room, np.uint64)))
    args = difference, top, active, number(0.5), most, np.array([span], number), INTERPOLATED, np.uint64(0)
    keys, n = fire(*args, keys, 3)
    expected = []
    for y, x in np.ndindex(shape):
        d = abs(float(difference[y, x]))
        if active[y // TILE[0], x // TILE[1]] and d >= 0.5:
            for k in range(1, min(int(d / 0.5), most) + 1):
                expected.append((y + top, x, difference[y, x] > 0, k * span * 0.5 / d))
    assert (keys[:3] == earlier).all()
    found = keys[3:n]
    assert [(k >> 17 & 0x7FFF, k >> 1 & 0xFFFF, k & 1) for k in found.tolist()] == [e[:3] for e in expected]
    np.testing.assert_allclose(found >> np.uint64(32), [e[3] for e in expected], rtol=0, atol=0.51)
