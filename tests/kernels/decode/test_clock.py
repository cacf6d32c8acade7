"""Times of counters that wrap, at exactly the bounds between a camera's times and damage."""

from itertools import pairwise

import numpy as np
import pytest

from nvsdata.kernels.decode.clock import (
    BEGUN,
    DENSE,
    FELL,
    HIDDEN,
    JUMP,
    LAST,
    MIXED,
    NEXT,
    UNKNOWN,
    clock_at,
    extremes,
    first_time,
    go_evenly,
    is_jump,
    kept_words,
    lasting,
    nearest_time,
    unwrap,
)

WRAP, HALF = 2**32, 2**31
# µs: how far buffers hold events back, how long no camera is silent, what an index sees of a block
BACK_US, SILENT_US, SOON_US, PEEK_US = 100_000, 300_000_000, 2**26, 100_000
PEEK = 16  # records


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (1_000, 900, False),
        (1_000, 899, True),
        (50, 0, False),
        (50, -1, True),
        (-7, 0, False),
        (0, WRAP - 1, False),
        (WRAP - 1, WRAP + 6, False),
        (WRAP - 1, WRAP + 7, True),
        (WRAP - 8, WRAP, True),
        (WRAP - 7, WRAP, False),
        (2 * WRAP - 7, 2 * WRAP, False),
        (2 * WRAP - 8, 2 * WRAP, True),
    ],
)
def test_what_no_camera_writes(before, after, expected):
    # steps back by up to 100, silences of up to 7 across a wrap
    assert is_jump(before, after, 32, 100, 7) == expected


def test_the_nearest_time_is_at_most_half_a_wrap_away():
    for last in range(40):
        for raw in range(16):
            time = nearest_time(raw, last, 4)
            assert time % 16 == raw
            assert -8 <= time - last < 8


@pytest.mark.parametrize(("bits", "lost"), [(12, False), (13, True), (28, True), (32, True)])
def test_a_first_word_of_ones_is_lost_memory_unless_it_is_short(bits, lost):
    ones = 2**bits - 1
    assert first_time(ones, bits) == (-1 if lost else ones)
    assert first_time(ones - 1, bits) == ones - 1
    assert first_time(0, bits) == 0


def passed(times, record=0, block=100, even=False, start=UNKNOWN):
    """The state after records of a clock that shows `times` up to whole wraps; and the times."""
    state = clock_at(start, record)
    t = np.array(times, np.int64)
    if even:
        go_evenly(state, t, block)
    else:
        t %= WRAP
        unwrap(state, t, block)
        assert t.tolist() == list(times)
    return state


def test_a_clock_begins_without_faults():
    state = clock_at(5, 7)
    assert state[[LAST, BEGUN, NEXT]].tolist() == [5, 5, 7]
    assert state[[DENSE, FELL, MIXED]].tolist() == [0, 0, 0]
    assert state[[JUMP, HIDDEN]].tolist() == [-1, -1]
    for even in (False, True):
        after = passed([9, 10, 12], 30, even=even)
        assert after[[LAST, BEGUN, NEXT]].tolist() == [12, 9, 33]
        assert after[[FELL, JUMP, HIDDEN]].tolist() == [0, -1, -1]
    assert passed([])[[LAST, NEXT]].tolist() == [UNKNOWN, 0]


@pytest.mark.parametrize(
    ("times", "fell", "jump"),
    [
        ([200_000, 200_000], 0, -1),
        ([200_000, 199_999], 1, -1),
        ([200_000, 200_000 - BACK_US], 1, -1),
        ([200_000, 200_001, 200_000 - BACK_US], 1, 43),
        ([50, 0], 1, -1),
        ([50, -1], 1, 42),
        ([0, SILENT_US + 1], 0, -1),
        ([WRAP - 9, WRAP - 8, WRAP - 8 + SILENT_US], 0, -1),
        ([WRAP - 9, WRAP - 8, WRAP - 7 + SILENT_US], 0, 43),
        ([3 * WRAP + 9, 3 * WRAP + 10 + SILENT_US], 0, -1),
        ([HALF - 5, HALF + SILENT_US, HALF], 1, 43),
        # the first of two counts
        ([WRAP - 9, WRAP - 7 + SILENT_US, WRAP - 8], 1, 42),
    ],
)
def test_falls_and_jumps_are_noted_at_their_bounds(times, fell, jump):
    # words begin in the first wrap, unless they are said to
    state = passed(times, 41, start=times[0])
    assert state[[FELL, JUMP]].tolist() == [fell, jump]
    assert state[LAST] == times[-1]


@pytest.mark.parametrize(
    ("first", "fell", "jump"), [(500_000, 0, -1), (499_999, 1, -1), (400_000, 1, -1), (399_999, 1, 9)]
)
def test_times_that_go_evenly_are_compared_with_the_one_before_them(first, fell, jump):
    state = passed([first, first + 1], 9, even=True, start=500_000)
    assert state[[FELL, JUMP]].tolist() == [fell, jump]
    later = state.copy()
    go_evenly(later, np.array([first - 300_000]), 100)
    assert later[JUMP] == (jump if jump >= 0 else 11)


def test_the_first_word_sets_the_clock():
    for words, times, jump in (([HALF - 1, HALF], [HALF - 1, HALF], -1), ([WRAP - 1, 3], [-1, 3], 7), ([], [], -1)):
        state, t = clock_at(UNKNOWN, 7), np.array(words, np.int64)
        unwrap(state, t, 100)
        assert t.tolist() == times
        assert state[JUMP] == jump
    # in the middle of a wrap a silence may be long
    for even in (False, True):
        assert passed([HALF + SILENT_US, HALF + SILENT_US], 9, even=even, start=HALF - 5)[JUMP] == -1


def test_words_are_kept_after_a_silence_of_any_length_unless_one_is_told():
    words = np.array([HALF + 5, 4])
    assert kept_words(words, 32, 100).tolist() == [True, True]
    assert kept_words(words, 32, 100, SILENT_US).sum() == 1


def strides(dense, last, begin=0):
    """Times of a block of `PEEK` records, the last of which comes after `dense`; then of others up to `last`."""
    t = [begin + k * dense // (PEEK - 1) for k in range(PEEK)]
    while last - t[-1] >= HALF:
        t.append(t[-1] + HALF - 1)
    return [*t, last]


@pytest.mark.parametrize(
    ("dense", "last", "hidden"),
    [
        (PEEK_US, WRAP + SOON_US, True),
        (PEEK_US + 1, WRAP + SOON_US, False),
        (PEEK_US, WRAP + SOON_US + 1, False),
        (PEEK_US, WRAP + 1, True),
        (PEEK_US, WRAP, False),
        (PEEK_US, SOON_US, False),
    ],
)
def test_a_block_that_lasts_longer_than_an_index_sees_is_noted(dense, last, hidden):
    times = strides(dense, 7_000 + last, 7_000)
    state = passed(times, 0, len(times) - 1)
    assert state[HIDDEN] == (len(times) - 1 if hidden else -1)
    assert state[BEGUN] == 7_000 + last
    # a block may begin before a piece of records
    state = passed(times, 1, len(times), start=0)
    assert state[HIDDEN] == -1


def test_a_block_is_dense_only_with_enough_records():
    for n in (PEEK - 1, PEEK):
        assert passed(range(n), 0)[DENSE] == (n == PEEK)
        assert passed(range(n + 3), 97)[[DENSE, BEGUN]].tolist() == [n == PEEK, 3]
    for long in (0, 1):
        t = [0, 5, 8, *range(10, 10 + PEEK - 1), 10 + PEEK_US + long]
        assert passed(t, 97)[DENSE] == 1 - long


def test_how_long_words_last_and_whether_one_is_damaged():
    def of(*times):
        time, damaged = lasting(np.array(times).astype(np.uint32))
        return time, bool(damaged)

    assert of(7) == (0, False)
    assert of(7, 17, 12) == (5, False)
    assert of(0, SILENT_US + 1) == (SILENT_US + 1, False)
    assert of(WRAP - 1, WRAP - 1 + SILENT_US) == (SILENT_US, False)
    assert of(WRAP - 1, WRAP + SILENT_US, WRAP + SILENT_US) == (SILENT_US + 1, True)
    assert of(5, HALF, WRAP - 1, WRAP + 4, WRAP + 3) == (WRAP - 2, False)


@pytest.mark.parametrize("n", [0, 1, 3, 4, 5, 8])
def test_first_lowest_and_highest_time_of_blocks(n):
    t = np.random.default_rng(n).integers(-50, 50, n)
    rows = np.zeros((3, -(-n // 4)), np.int64)
    extremes(t, 4, *rows)
    blocks = [t[k : k + 4].tolist() for k in range(0, n, 4)]
    assert rows.tolist() == [[block[0] for block in blocks], [min(block) for block in blocks], list(map(max, blocks))]


def test_many_words_are_unwrapped_as_one_by_one():
    rng = np.random.default_rng(0)
    for start in (9, -7, 5 * WRAP - 400):
        words = (start + np.cumsum(rng.choice((0, 1, 7, -3, 150_000, -99_000), 1_500))) % WRAP
        state, t, times = clock_at(start, 0), words.copy(), []
        unwrap(state, t, 100)
        for word in words.tolist():
            times.append(nearest_time(word, times[-1] if times else start, 32))
        assert t.tolist() == times
        steps = list(pairwise([start, *times]))
        jumps = [is_jump(*step, 32, BACK_US, SILENT_US) for step in steps]
        assert state[JUMP] == (jumps.index(True) if True in jumps else -1)
        assert state[FELL] == any(after < before for before, after in steps)


def test_a_time_below_0_before_the_words_is_none_of_theirs():
    state = clock_at(-7, 0)
    unwrap(state, np.arange(5), 100)
    assert state[[FELL, JUMP]].tolist() == [0, -1]
