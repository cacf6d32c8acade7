"""Arrays of wrong sizes and random bytes: errors, and nothing written outside of the columns."""

from functools import partial

import numpy as np
import pytest

from nvsdata.kernels.decode.aedat2 import DAVIS, DVS128, aedat2_decode, aedat2_encode
from nvsdata.kernels.decode.aedat3 import aedat3_decode, aedat3_packets
from nvsdata.kernels.decode.atis import ATIS_BEGUN, atis_decode, atis_encode, atis_walk
from nvsdata.kernels.decode.clock import (
    UNKNOWN,
    clock_at,
    extremes,
    first_time,
    go_evenly,
    is_jump,
    kept_words,
    nearest_time,
    unwrap,
)
from nvsdata.kernels.decode.dat import dat_decode

KINDS = np.int64, np.int16, np.int16, np.uint8


def columns_of(n):
    return [np.full(n, 9, kind) for kind in KINDS]


def atis_state():
    return np.array([0, 0, 0, -1])


def packets_of(raw):
    """An index of one packet, of all bytes."""
    return np.array([[0, raw.size // 8, 0, 0, 1_000, 0]])


# bytes of a record; a decoder of bytes, a state, an index and columns; a state
DECODERS = {
    "atis": (5, lambda raw, *rest: atis_decode(raw, 30, 30, *rest), atis_state),
    "dat1": (8, lambda raw, *rest: dat_decode(raw, 4, 1, 30, 30, *rest), partial(clock_at, UNKNOWN, 0)),
    "dat2": (8, lambda raw, *rest: dat_decode(raw, 4, 2, 30, 30, *rest), partial(clock_at, UNKNOWN, 0)),
    "dvs128": (8, lambda raw, *rest: aedat2_decode(raw, 4, DVS128, 128, 128, 30, 30, *rest), partial(clock_at, 5, 8)),
    "davis": (8, lambda raw, *rest: aedat2_decode(raw, 4, DAVIS, 240, 180, 30, 30, *rest), partial(clock_at, 5, 8)),
    "aedat3": (
        8,
        lambda raw, state, *rest: aedat3_decode(raw, 0, packets_of(raw), 30, 30, *rest),
        partial(clock_at, 5, 8),
    ),
}
every = pytest.mark.parametrize(("size", "decode", "state"), DECODERS.values(), ids=DECODERS)


@every
@pytest.mark.parametrize("short", range(4))
def test_columns_have_room_for_an_event_per_record(size, decode, state, short):
    raw, columns = np.zeros(7 * size, np.uint8), columns_of(9)
    for kept in (3, -1, 2**63 - 1, -(2**63)):
        with pytest.raises(ValueError, match="too short"):
            decode(raw, state(), kept, *columns)
    columns[short] = columns[short][:8]
    with pytest.raises(ValueError, match="too short"):
        decode(raw, state(), 2, *columns)
    assert all((column == 9).all() for column in columns)
    assert decode(raw, state(), 1, *columns)[0] == 7


@every
def test_columns_have_their_own_types(size, decode, state):
    raw = np.zeros(2 * size, np.uint8)
    for place in range(4):
        columns = columns_of(2)
        columns[place] = columns[place].astype(np.int32)
        with pytest.raises(TypeError):
            decode(raw, state(), 0, *columns)
        columns = columns_of(2)
        columns[place].flags.writeable = False
        with pytest.raises(TypeError):
            decode(raw, state(), 0, *columns)
    with pytest.raises(TypeError):
        decode(raw.astype(np.int8), state(), 0, *columns_of(2))


@every
def test_random_bytes_write_no_more_than_their_records(size, decode, state):
    rng = np.random.default_rng(0)
    for n in (0, 1, 2, 511, 512, 513, 1_500):
        for torn in range(3):
            raw, columns = rng.integers(0, 256, n * size + torn).astype(np.uint8), columns_of(n + 3)
            count = decode(raw, state(), 2, *columns)[0]
            assert 0 <= count <= n
            assert [column[[0, 1, -1]].tolist() for column in columns] == [[9, 9, 9]] * 4


@every
def test_strided_bytes_are_copied(size, decode, state):
    raw = np.random.default_rng(1).integers(0, 256, 9 * size).astype(np.uint8)
    some, others = columns_of(9), columns_of(9)
    assert decode(raw, state(), 0, *some) == decode(raw.repeat(2)[::2], state(), 0, *others)
    assert [column.tolist() for column in some] == [column.tolist() for column in others]


@every
def test_a_state_has_its_own_size(size, decode, state):
    if decode is not DECODERS["aedat3"][1]:
        for wrong in (state()[:-1], np.append(state(), 0)):
            with pytest.raises(ValueError, match="state"):
                decode(np.zeros(size, np.uint8), wrong, 0, *columns_of(1))


@pytest.mark.parametrize(("block", "record"), [(0, 0), (-1, 0), (-(2**63), 0), (4, -1), (4, -(2**63))])
def test_blocks_have_records_and_records_count_from_0(block, record):
    state, walk = clock_at(UNKNOWN, record), np.array(ATIS_BEGUN)
    walk[7] = record
    for advance in (unwrap, go_evenly):
        with pytest.raises(ValueError, match="block"):
            advance(state, np.zeros(3, np.int64), block)
    with pytest.raises(ValueError, match="block"):
        atis_walk(np.zeros(5, np.uint8), block, walk, np.zeros(1, np.int64), np.zeros((1, 1), np.int64))
    # one of more records than there are is none of few
    state = clock_at(UNKNOWN, 2**62)
    unwrap(state, np.arange(3), 2**63 - 1)
    assert state[4] == 2**62 + 3


def test_there_is_a_place_for_each_block():
    raw = np.zeros(5 * 9, np.uint8)
    for n, columns in ((2, 1), (3, 2), (0, 1)):
        with pytest.raises(ValueError, match="places"):
            atis_walk(raw, 4, np.array(ATIS_BEGUN), np.zeros(n, np.int64), np.zeros((n, columns), np.int64))
    walk = np.array(ATIS_BEGUN)
    walk[7] = 2**63 - 2
    with pytest.raises(ValueError, match="places"):
        atis_walk(raw, 4, walk, np.zeros(3, np.int64), np.zeros((3, 1), np.int64))
    with pytest.raises(ValueError, match="places"):
        extremes(np.arange(9), 4, *np.zeros((3, 2), np.int64))
    with pytest.raises(ValueError, match="block"):
        extremes(np.arange(9), 0, *np.zeros((3, 2), np.int64))


@pytest.mark.parametrize("bits", [-1, 0, 62, 64, 2**40])
def test_counters_have_1_to_61_bits(bits):
    for ask in (
        lambda: nearest_time(1, 2, bits),
        lambda: first_time(1, bits),
        lambda: is_jump(1, 2, bits, 3, 4),
        lambda: kept_words(np.arange(3), bits, 5),
    ):
        with pytest.raises(ValueError, match="bits"):
            ask()


def test_words_may_be_anything():
    words = np.random.default_rng(2).integers(-(2**63), 2**63 - 1, 500)
    for bits in (1, 12, 61):
        for back in (0, 2**62, 2**63 - 1):
            assert kept_words(words, bits, back).shape == (500,)
            assert kept_words(words, bits, back, -(2**63)).shape == (500,)
    for start in (UNKNOWN, 2**63 - 1, -(2**63)):
        state = clock_at(start, 0)
        unwrap(state, words.copy(), 7)
        go_evenly(state, words, 7)


def test_events_to_encode_are_sorted_and_complete():
    columns = columns_of(3)
    columns[0][:] = 0, 2**24, 0
    with pytest.raises(ValueError, match="sorted"):
        atis_encode(*columns, 0)
    columns[3] = columns[3][:2]
    for encode in (partial(atis_encode, offset=0), partial(aedat2_encode, layout=DAVIS, chip_width=9, chip_height=9)):
        with pytest.raises(ValueError, match="equally long"):
            encode(*columns)
    for chip in ((0, 9), (9, 2**15 + 1), (-(2**63), 1)):
        with pytest.raises(ValueError, match="chip"):
            aedat2_encode(*columns_of(1), DVS128, *chip)


@pytest.mark.parametrize(
    ("first", "number"), [(16, 1), (-8, 1), (8, 2), (0, 3), (0, -1), (2**63 - 1, 1), (-(2**63), 1), (0, 2**61 + 1)]
)
def test_packets_lie_within_the_bytes(first, number):
    packets = np.array([[first, number, 0, 0, 0, 0]])
    with pytest.raises(ValueError, match="packet lies outside"):
        aedat3_decode(np.zeros(16, np.uint8), 0, packets, 30, 30, 0, *columns_of(9))
    with pytest.raises(ValueError, match="state"):
        aedat3_decode(np.zeros(16, np.uint8), 0, packets[:, :5].copy(), 30, 30, 0, *columns_of(9))


def test_random_headers_are_walked_within_the_file():
    rng = np.random.default_rng(3)
    for n in (0, 1, 27, 28, 29, 36, 37, 400):
        for _ in range(200):
            raw = rng.choice((0, 0, 0, 1, 4, 8, 255), n).astype(np.uint8)
            start, claimed = int(rng.integers(0, n + 1)), n + int(rng.choice((0, 1, 50)))
            packets, _, at = aedat3_packets(raw, -1, claimed, start)
            assert start <= at <= max(claimed, start)
            assert (packets[:, 0] + 8 * packets[:, 1] <= claimed).all()
    with pytest.raises(ValueError, match="before the file"):
        aedat3_packets(np.zeros(9, np.uint8), -1, 9, -1)
