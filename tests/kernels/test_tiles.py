import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nvsdata.kernels.emulate import _touches
from nvsdata.kernels.tiles import TILE, find_dirty, spread


@given(
    seed=st.integers(0, 2**32 - 1),
    height=st.integers(1, 40),
    width=st.integers(1, 200),
    channels=st.sampled_from([1, 3, 8]),
    changes=st.integers(0, 12),
)
def test_dirty_tiles_are_those_with_a_byte_that_changed(seed, height, width, channels, changes):
    rng = np.random.default_rng(seed)
    before = rng.integers(0, 256, (height, width, channels), dtype=np.uint8)
    after = before.copy()
    expected = np.zeros((-(-height // TILE[0]), -(-width // TILE[1])), bool)
    for y, x, c in zip(*(rng.integers(0, n, changes) for n in before.shape), strict=True):
        after[y, x, c] = before[y, x, c] ^ 1
        expected[y // TILE[0], x // TILE[1]] = True
    found = rng.random(expected.shape) < 0.5
    count = find_dirty(after.reshape(height, -1), before.reshape(height, -1), channels * TILE[1], found)
    assert (found == expected).all()
    assert count == expected.sum()


@given(st.integers(1, 6), st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_marks_spread_to_all_eight_neighbors(rows, columns, seed):
    marks = np.random.default_rng(seed).random((rows, columns)) < 0.2
    padded = np.pad(marks, 1)
    expected = np.any([padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)
    found = np.empty_like(marks)
    spread(marks, found)
    assert (found == expected).all()


@given(data=st.data(), rows=st.integers(1, 5), columns=st.integers(1, 5))
def test_a_box_touches_the_tiles_that_have_some_of_its_pixels(data, rows, columns):
    active = np.array(data.draw(st.lists(st.booleans(), min_size=rows * columns, max_size=rows * columns)))
    active = active.reshape(rows, columns)
    top = data.draw(st.integers(0, rows * TILE[0] - 1))
    left = data.draw(st.integers(0, columns * TILE[1] - 1))
    bottom = data.draw(st.integers(top + 1, rows * TILE[0]))
    right = data.draw(st.integers(left + 1, columns * TILE[1]))
    pixels = active.repeat(TILE[0], 0).repeat(TILE[1], 1)
    assert _touches(active, top, bottom, left, right) == pixels[top:bottom, left:right].any()
