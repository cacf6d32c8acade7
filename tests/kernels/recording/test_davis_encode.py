"""Words that a simulated camera sends, one by one."""

import numpy as np
import pytest

from nvsdata.kernels.recording.davis_stream import encode

TIME, WRAP, ROW, OFF, ON = 0x8000, 0x7000, 0x1000, 0x2000, 0x3000


def sent(events, state):
    t, x, y, p = np.array(events, np.int64).reshape(-1, 4).T
    words = np.empty(100, np.uint16)
    return words[: encode(t, x, y, p, state, words)].tolist()


def test_times_and_rows_are_sent_when_they_change():
    state = np.array([0, -1, -1])
    events = [(5, 1, 7, 1), (5, 2, 7, 0), (5, 3, 8, 1), (6, 4, 8, 1), (6, 4, 8, 0)]
    assert sent(events, state) == [
        *(TIME | 5, ROW | 7, ON | 1, OFF | 2),
        *(ROW | 8, ON | 3),
        *(TIME | 6, ROW | 8, ON | 4, OFF | 4),
    ]
    assert state.tolist() == [0, 6, 8]
    # the next piece goes on with the same time and row
    assert sent([(6, 9, 8, 1), (6, 9, 9, 1)], state) == [ON | 9, ROW | 9, ON | 9]


def test_wraps_of_the_clock_are_counted():
    state = np.array([0, -1, -1])
    assert sent([(0x8000, 1, 2, 1)], state) == [WRAP | 1, ROW | 2, ON | 1]
    assert sent([(0x8000 * 4 + 3, 1, 2, 0)], state) == [WRAP | 3, TIME | 3, ROW | 2, OFF | 1]
    assert sent([(0x8000 * 5000, 1, 2, 0)], state) == [WRAP | 4095, WRAP | 901, ROW | 2, OFF | 1]


def test_words_without_room():
    events = np.zeros((3, 1), np.int64)
    with pytest.raises(ValueError, match="more words"):
        encode(np.array([1 << 62]), *events, np.array([0, -1, -1]), np.empty(9, np.uint16))
    with pytest.raises(ValueError, match="equally long"):
        encode(np.array([1, 2]), *events, np.array([0, -1, -1]), np.empty(9, np.uint16))
