import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsdata.kernels.emulate.frames import TILE, find_dirty
from nvsdata.kernels.emulate.pix2nvs import CO_LOCATED, Pixels, Rule, Tiles, mark_tiles


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
def test_what_is_relative_to_neighbors_affects_all_eight_tiles_around(rows, columns, seed):
    changed = np.random.default_rng(seed).random((rows, columns)) < 0.2
    padded = np.pad(changed, 1)
    expected = np.any([padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)
    none = np.zeros((0, 0))
    rule = Rule(True, none.ravel(), 0.0, 1.0, CO_LOCATED, none, 1, 1.0, 1, 0, 1.0, True, 0.0)
    before = np.zeros((rows * TILE[0], columns * TILE[1]), np.uint8)
    after = changed.repeat(TILE[0], 0).repeat(TILE[1], 1).astype(np.uint8)
    dirty, affected, active = np.zeros((3, rows, columns), bool)
    tiles = Tiles(dirty, affected, active, np.ones((rows, columns), bool), np.zeros((rows, columns), np.int64))
    level = np.zeros(before.shape)
    assert mark_tiles(after, before, rule, tiles, Pixels(level, level, level.copy(), level)) == changed.any()
    assert (dirty == changed).all()
    assert (affected == expected).all()
    assert (active == expected).all()


@pytest.mark.parametrize(
    ("frame", "previous", "tile_bytes", "tiles"),
    [
        ((9, 65), (9, 64), 64, (2, 2)),
        ((9, 65), (8, 65), 64, (2, 2)),
        ((9, 65), (9, 65), 64, (1, 2)),
        ((9, 65), (9, 65), 64, (2, 1)),
        ((9, 65), (9, 65), 0, (2, 2)),
        ((9, 65), (9, 65), -64, (2, 2)),
        ((9, 0), (9, 0), 64, (2, 1)),
    ],
)
def test_arrays_that_do_not_fit_are_refused(frame, previous, tile_bytes, tiles):
    with pytest.raises(ValueError, match="frames"):
        find_dirty(np.zeros(frame, np.uint8), np.zeros(previous, np.uint8), tile_bytes, np.zeros(tiles, bool))
