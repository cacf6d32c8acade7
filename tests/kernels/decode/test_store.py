"""Windows of stored columns, by their definition."""

import tempfile

import numpy as np
import pytest

from nvsdata.data.events import Columns
from nvsdata.kernels import _native
from nvsdata.kernels.decode.store import marked_range, read_window, stored_window

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


def in_file(file, stored):
    """Write columns to a file, each some bytes after the one before; return their places and widths."""
    begins = []
    for column in stored:
        file.write(b"\0\0\0")
        begins.append(file.tell())
        file.write(column.tobytes())
    file.flush()
    return (*begins, *(column.itemsize for column in stored[:3]))


def within(expected, start, stop):
    return [column[(expected.t >= start) & (expected.t < stop)].tolist() for column in expected]


@pytest.mark.parametrize("base", [0, -150, 1 << 40])
@pytest.mark.parametrize("types", TYPES)
def test_windows_are_those_of_the_definition(types, base):
    stored, expected = columns(types, base)
    with tempfile.TemporaryFile() as file:
        place = in_file(file, stored)
        for start, stop in WINDOWS:
            start, stop = (start + base, stop + base) if (start, stop) != EVER else EVER
            found = Columns.empty(N)
            count = stored_window(*found, base, start, stop, *stored)
            assert [column[:count].tolist() for column in found] == within(expected, start, stop)
            found = Columns.empty(N - 20)
            count = read_window(*found, base, start, stop, file.fileno(), 10, *place)
            some = expected.take(slice(10, N - 10))
            assert [column[:count].tolist() for column in found] == within(some, start, stop)
            marks = stored[0][::256]
            first, last = marked_range(marks, base, start, stop)
            blocks = np.flatnonzero((expected.t >= start) & (expected.t < stop)) // 256
            assert 0 <= first <= last <= marks.size
            assert not blocks.size or first <= blocks[0] <= blocks[-1] < last


@pytest.mark.parametrize("types", TYPES)
def test_what_a_file_lacks_is_noticed_wherever_it_ends(types):
    stored, _ = columns(types)
    with tempfile.TemporaryFile() as file:
        place = in_file(file, stored)
        size = file.tell()
        assert read_window(*Columns.empty(N), 0, *EVER, file.fileno(), 0, *place) == N
        for lo in (-(1 << 63), -1, N, 1 << 62, (1 << 63) - 1):
            assert read_window(*Columns.empty(2), 0, *EVER, file.fileno(), lo, *place) in (-1, 0, 1, 2)
        for end in [begin + 1 for begin in place[:4]] + [size - 1]:
            file.truncate(end)
            assert read_window(*Columns.empty(N), 0, *EVER, file.fileno(), 0, *place) == -1
    assert read_window(*Columns.empty(N), 0, *EVER, -1, 0, *place) == -1


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
    outputs = [column[: N - (number == 3)] for number, column in enumerate(Columns.empty(N))]
    with tempfile.TemporaryFile() as file:
        place = in_file(file, stored)
        with pytest.raises(ValueError, match="columns"):
            read_window(*outputs, 0, *EVER, file.fileno(), 0, *place)
        for at in range(3):
            widths = [3 if number == at else width for number, width in enumerate(place[4:])]
            with pytest.raises(ValueError, match="bytes"):
                read_window(*Columns.empty(N), 0, *EVER, file.fileno(), 0, *place[:4], *widths)


@pytest.mark.skipif(not _native.checks_bounds, reason="needs the build that counts touched elements")
def test_marks_are_bisected():
    marks = np.arange(1 << 20, dtype=np.uint32)
    _native.touched()
    marked_range(marks, 0, 1_000, 2_000)
    assert _native.touched() <= 2 * 21
