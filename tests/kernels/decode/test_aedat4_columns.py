"""Events of AEDAT 4 by the definition of their sixteen bytes."""

import numpy as np
import pytest

from nvsdata.data.events import LATEST, Columns
from nvsdata.formats.aedat.aedat4_packets import EVENT
from nvsdata.kernels.decode.aedat4 import aedat4_decode

SIZE = 5, 3


def decoded(*rows):
    events = np.zeros(len(rows), EVENT)
    for at, row in enumerate(rows):
        events[at] = (*row, b"\xff\xff\xff")
    columns = Columns.empty(len(rows))
    return aedat4_decode(np.frombuffer(events.tobytes(), np.int64), LATEST, *SIZE, *columns), columns


def test_columns_are_those_of_the_structures():
    rows = [(0, 0, 0, 0), (-LATEST + 1, 4, 2, 1), (LATEST - 1, 3, 1, 0), (12, 4, 0, 1)]
    valid, columns = decoded(*rows)
    assert valid
    assert list(zip(*(column.tolist() for column in columns), strict=True)) == rows
    assert decoded()[0]


TIMES = (LATEST, 0, 0, 0), (-LATEST, 0, 0, 0)
PLACES = (0, 5, 0, 0), (0, 0, 3, 0), (0, -1, 0, 0), (0, 0, -1, 0)


@pytest.mark.parametrize("row", [*TIMES, *PLACES, (0, 0, 0, 2)])
def test_one_odd_event_anywhere_is_noticed(row):
    fine = (1, 1, 1, 1)
    for place in range(3):
        rows = [fine] * 3
        rows[place] = row
        assert not decoded(*rows)[0]


def test_arrays_that_do_not_fit_are_refused():
    words, columns = np.zeros(4, np.int64), Columns.empty(2)
    for at in range(4):
        short = [column[: 2 - (number == at)] for number, column in enumerate(columns)]
        with pytest.raises(ValueError, match="too short"):
            aedat4_decode(words, LATEST, *SIZE, *short)
    with pytest.raises(ValueError, match="two words"):
        aedat4_decode(words[:3], LATEST, *SIZE, *columns)
    for latest in (0, -1, LATEST + 1):
        with pytest.raises(ValueError, match=r"2\^62"):
            aedat4_decode(words, latest, *SIZE, *columns)


@pytest.mark.parametrize("size", [1, 511, 512, 513, 1500])
def test_the_only_odd_event_of_many(size):
    rng = np.random.default_rng(size)
    events = np.zeros(size, EVENT)
    for at in {0, size // 2, size - 1, *rng.integers(0, size, 5).tolist()}:
        for row in (*TIMES, *PLACES, (0, 0, 0, 2), (-(1 << 63), 0, 0, 0), ((1 << 63) - 1, 0, 0, 0)):
            events[:] = (1, 1, 1, 1, b"\0\0\0")
            words = np.frombuffer(events.tobytes(), np.int64)
            assert aedat4_decode(words, LATEST, *SIZE, *Columns.empty(size))
            events[at] = (*row, b"\0\0\0")
            words = np.frombuffer(events.tobytes(), np.int64)
            assert not aedat4_decode(words, LATEST, *SIZE, *Columns.empty(size))
