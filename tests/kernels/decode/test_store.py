"""Windows of stored columns, by their definition."""

import numpy as np
import pytest

from nvsdata.data.events import Columns
from nvsdata.kernels.decode.store import marked_range, stored_window

TYPES = [(t, x, y) for t in ("u4", "i8") for x in ("u1", "u2") for y in ("u1", "u2")]
N = 700
EVER = -(1 << 62), 1 << 62
WINDOWS = [EVER, (0, 0), (5, 4), (-9, 3), (17, 18), (100, 220), (0, 230), (400, 900)]


def columns(types, base=0):
    """N events from `base` on: as they are stored, and as they are returned."""
    rng = np.random.default_rng(1)
    t, x, y, p = np.sort(rng.integers(0, 230, N)), *rng.integers(0, 256, (2, N)), rng.integers(0, 2, N)
    stored = tuple(column.astype(kind) for column, kind in zip((t, x, y, p), (*types, "u1"), strict=True))
    return stored, Columns(t + base, x.astype(np.int16), y.astype(np.int16), p.astype(np.uint8))


def within(expected, start, stop):
    return [column[(expected.t >= start) & (expected.t < stop)].tolist() for column in expected]


@pytest.mark.parametrize("base", [0, -150, 1 << 40])
@pytest.mark.parametrize("types", TYPES)
def test_windows_are_those_of_the_definition(types, base):
    stored, expected = columns(types, base)
    for start, stop in WINDOWS:
        start, stop = (start + base, stop + base) if (start, stop) != EVER else EVER
        found = Columns.empty(N)
        count = stored_window(*found, base, start, stop, *stored)
        assert [column[:count].tolist() for column in found] == within(expected, start, stop)
        marks = stored[0][::256]
        first, last = marked_range(marks, base, start, stop)
        blocks = np.flatnonzero((expected.t >= start) & (expected.t < stop)) // 256
        assert 0 <= first <= last <= marks.size
        assert not blocks.size or first <= blocks[0] <= blocks[-1] < last


def test_times_out_of_order_or_that_overflow_do_no_harm():
    for seed in range(50):
        rng = np.random.default_rng(seed)
        t = rng.integers(-(1 << 63), (1 << 63) - 1, N)
        rest = np.zeros(N, np.uint8)
        for base in (-(1 << 63), 5, (1 << 63) - 1):
            for start, stop in (EVER, (-5, 5), EVER[::-1]):
                assert 0 <= stored_window(*Columns.empty(N), base, start, stop, t, rest, rest, rest) <= N
                first, last = marked_range(t, base, start, stop)
                assert 0 <= first <= last <= N


def test_arrays_that_do_not_fit_are_refused():
    stored, _ = columns(TYPES[0])
    for at in range(4):
        short = [column[: N - (number == at)] for number, column in enumerate(stored)]
        with pytest.raises(ValueError, match="columns"):
            stored_window(*Columns.empty(N), 0, *EVER, *short)
        outputs = [column[: N - (number == at)] for number, column in enumerate(Columns.empty(N))]
        with pytest.raises(ValueError, match="columns"):
            stored_window(*outputs, 0, *EVER, *stored)
        wrong = [column.astype("f4") if number == at else column for number, column in enumerate(stored)]
        with pytest.raises(TypeError):
            stored_window(*Columns.empty(N), 0, *EVER, *wrong)
