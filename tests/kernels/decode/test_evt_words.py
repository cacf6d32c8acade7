"""Random words of EVT 2, 2.1 and 3 against a slow decoder, and the words of time that are written."""

from itertools import pairwise

import numpy as np
import pytest

from nvsdata.kernels.decode.clock import first_time, is_jump, nearest_time
from nvsdata.kernels.decode.evt import UNSEEN, count_shown
from nvsdata.kernels.decode.evt2 import evt2_decode, evt2_encode, evt2_walk, evt21_count, evt21_decode, evt21_walk
from nvsdata.kernels.decode.evt3 import evt3_count, evt3_decode, evt3_encode, evt3_walk

FAR = 32_767
KERNELS = {
    "evt2": (evt2_walk, evt2_decode, np.dtype("<u4"), 28, 6),
    "evt2.1": (evt21_walk, evt21_decode, np.dtype("<u8"), 28, 6),
    "evt3": (evt3_walk, evt3_decode, np.dtype("<u2"), 12, 12),
}
every = pytest.mark.parametrize("kind", KERNELS)


def random_words(rng, kind, n, wild):
    """Words of all types, with words of time that mostly go on; `wild` ones don't."""
    bits = KERNELS[kind][3]
    high = rng.integers(0, 2**bits) + np.cumsum(rng.choice((0, 1, 2), n))
    high = np.where(rng.random(n) < wild, rng.choice((2**bits - 1, 0, 2 ** (bits - 1)), n), high) % 2**bits
    if kind == "evt3":
        types = rng.choice((0, 2, 3, 4, 5, 6, 8, 10, 15), n, p=(0.1, 0.2, 0.1, 0.15, 0.1, 0.1, 0.15, 0.05, 0.05))
        return types << 12 | np.where(types == 8, high, rng.integers(0, 4_096, n))
    types = rng.choice((0, 1, 8, 10, 15), n, p=(0.3, 0.3, 0.3, 0.05, 0.05))
    words = types << 28 | np.where(types == 8, high, rng.integers(0, 2**28, n))
    mask = np.where(rng.random(n) < 0.2, 0, rng.integers(0, 2**32, n) & rng.integers(0, 2**32, n))
    return words.astype(np.uint64) | (mask.astype(np.uint64) << np.uint64(32) if kind == "evt2.1" else np.uint64(0))


def slow(kind, words):
    """The state before each word and after the last; events as (word, t, x, y, p); the first jump."""
    _, _, _, bits, shift = KERNELS[kind]
    high, low, row, base, polarity, jump = -1, 0, 0, 0, 0, -1
    states, events = [], []
    for i, word in enumerate(words.tolist()):
        states.append([high, low, row, base, polarity] if kind == "evt3" else [high])
        mask, word = word >> 32, word & 0xFFFFFFFF
        code, some = (word >> 12, []) if kind == "evt3" else (word >> 28, [])
        if code == 8:
            raw = word & (2**bits - 1)
            now = int(nearest_time(raw, high >> shift, bits) if high >= 0 else first_time(raw, bits)) << shift
            if jump < 0 and (is_jump(high, now, bits + shift, 100_000, 300_000_000) if high >= 0 else now < 0):
                jump = i
            low = low if now == high else 0
            high = now
        elif kind == "evt3":
            row = word & 0x7FF if code == 0 else row
            low = word & 0xFFF if code == 6 else low
            if code == 2:
                some = [(word & 0x7FF, row, word >> 11 & 1)]
            elif code == 3:
                base, polarity = word & 0x7FF, word >> 11 & 1
            elif code in (4, 5):
                size = 12 if code == 4 else 8
                some = [(base + k, row, polarity) for k in range(size) if word >> k & 1]
                base += size
        elif code < 2:
            low, x, y = word >> 22 & 63, word >> 11 & 0x7FF, word & 0x7FF
            some = [(x + k, y, code) for k in range(32) if mask >> k & 1] if kind == "evt2.1" else [(x, y, code)]
        if high >= 0:
            events += [(i, high + low, min(x, FAR), y, p) for x, y, p in some]
    states.append([high, low, row, base, polarity] if kind == "evt3" else [high])
    return states, events, jump


def pieces_of(rng, words, block):
    """The words in two pieces, of which the second begins with a block; as bytes."""
    cut = int(rng.integers(0, len(words) // block + 1)) * block
    return [part.view(np.uint8) for part in (words[:cut], words[cut:])]


@every
@pytest.mark.parametrize("wild", [0, 0.02, 0.3])
def test_words_are_walked_over_and_decoded_as_by_a_slow_decoder(kind, wild):
    walk, decode, unit, _, _ = KERNELS[kind]
    rng = np.random.default_rng(3)
    for n in (0, 1, 2, 5, 12, 40, 90) * 4:
        words = random_words(rng, kind, n, wild).astype(unit)
        states, events, jump = slow(kind, words)
        block = int(rng.choice((1, 4, 7)))
        raws = pieces_of(rng, words, block)
        begun = range(0, n, block)
        found, times = np.full((n + 1, len(states[0])), -9), np.full(n + 1, -9)
        state, seen = np.array([-1, 0, 0, 0, 0][: len(states[0])]), np.array(UNSEEN)
        for raw in raws:
            walk(raw, block, state, seen, found, times)
        assert found[: len(begun)].tolist() == [states[i] for i in begun]
        assert times[: len(begun)].tolist() == [[-1, *(e[1] for e in events if e[0] < i)][-1] for i in begun]
        assert state.tolist() == states[-1]
        when = [event[1] for event in events]
        falls = sum(b < a for a, b in pairwise(when))
        assert seen.tolist() == [when[-1] if when else -1, when[0] if when else -1, falls, n, jump]

        # sensors that end exactly at an event
        ends = [size for e in events[:1] for size in ((max(e[2], 1), 2_048), (FAR, max(e[3], 1)))]
        for size in ((FAR, FAR), (1_000, 1_500), *ends):
            state, seen = np.array([-1, 0, 0, 0, 0][: len(states[0])]), np.array(UNSEEN)
            room = (n if kind == "evt2" else len(events)) + 3  # EVT2's has room for an event per word
            columns = [np.zeros(room, c) for c in (np.int64, np.int16, np.int16, np.uint8)]
            kept, start = 1, 0
            for raw in raws:
                count, bad = decode(raw, *size, state, seen, kept, *columns)
                length = raw.size // unit.itemsize
                part = [e for e in events if start <= e[0] < start + length]
                outside = [e[0] - start for e in part if e[2] >= size[0] or e[3] >= size[1]]
                assert (count, bad) == (len(part), outside[0] if outside else -1)
                kept, start = kept + count, start + length
            assert list(zip(*(c[1:kept].tolist() for c in columns), strict=True)) == [e[1:] for e in events]
            assert state.tolist() == states[-1]
            assert seen[[3, 4]].tolist() == [n, jump]


def test_events_are_counted():
    rng = np.random.default_rng(4)
    for count, kind in ((evt21_count, "evt2.1"), (evt3_count, "evt3")):
        words = random_words(rng, kind, 200, 0).astype(KERNELS[kind][2])
        # with a time before all, every event counts
        first = np.array([8 << 28 if kind == "evt2.1" else 8 << 12], words.dtype)
        assert count(words.view(np.uint8)) == len(slow(kind, np.concatenate((first, words)))[1])
    for mask in (0, 1, 2**32 - 1, 0x80000000, 0x12345678, *rng.integers(0, 2**32, 50).tolist()):
        assert evt21_count(np.array([mask << 32], np.uint64).view(np.uint8)) == mask.bit_count()


@pytest.mark.parametrize("kind", ["evt2.1", "evt3"])
def test_too_little_room_is_an_error(kind):
    _, decode, unit, _, _ = KERNELS[kind]
    time, dense, many = (8 << 28, 0xF << 32, 4) if kind == "evt2.1" else (8 << 12, 0x4FFF, 12)
    raw = np.array([time, dense, dense], unit).view(np.uint8)
    for room, kept, error in ((2 * many, 0, None), (2 * many + 1, 1, None), (2 * many - 1, 0, "columns are too short")):
        columns = [np.zeros(room + 2, c) for c in (np.int64, np.int16, np.int16, np.uint8)]
        state, seen = np.array([-1, 0, 0, 0, 0][: 1 if kind == "evt2.1" else 5]), np.array(UNSEEN)
        short = [c[:room] for c in columns]
        if error:
            with pytest.raises(ValueError, match=error):
                decode(raw, FAR, FAR, state, seen, kept, *short)
        else:
            assert decode(raw, FAR, FAR, state, seen, kept, *short) == (2 * many, -1)
        assert not any(c[room:].any() for c in columns)


@every
def test_arrays_of_another_length_are_refused(kind):
    walk, decode, unit, _, _ = KERNELS[kind]
    raw = np.full(3, 2**unit.itemsize, unit).view(np.uint8)
    size = 5 if kind == "evt3" else 1
    state, seen, states, times = np.zeros(size, int), np.array(UNSEEN), np.zeros((3, size), int), np.zeros(3, int)
    columns = [np.zeros(4, c) for c in (np.int64, np.int16, np.int16, np.uint8)]
    walk(raw, 1, state, np.array(UNSEEN), states, times)
    for wrong in (
        (raw, 0, state, seen, states, times),
        (raw, -1, state, seen, states, times),
        (raw, 1, state[:0], seen, states, times),
        (raw, 1, state, seen[:4], states, times),
        (raw, 1, state, seen, states[:2], times[:2]),
        (raw, 1, state, seen, states[:2], times),
        (raw, 1, state, np.array([-1, -1, 0, 2, -1]), states, times),
        (raw, 1, state, np.array([-1, -1, 0, -(2**63), -1]), states, times),
        (raw, 2, state, np.array([-1, -1, 0, 1, -1]), states, times),
        (raw, 1, state, np.array([-1, -1, 0, 2**63 - 1, -1]), states, times),
    ):
        with pytest.raises(ValueError, match=r"block|number"):
            walk(*wrong)
    for kept in (-1, 5, 2**63 - 1, -(2**63)):
        with pytest.raises(ValueError, match="columns are too short"):
            decode(raw, FAR, FAR, state, seen, kept, *columns)
    with pytest.raises(ValueError, match="columns are too short"):
        decode(raw, FAR, FAR, state, seen, 0, *columns[:3], columns[3][:2])


@every
def test_any_state_is_taken(kind):
    """States may come from an index that is kept next to a file."""
    walk, decode, unit, _, _ = KERNELS[kind]
    rng = np.random.default_rng(6)
    extremes = 0, -1, 2**63 - 1, -(2**63), 2**62, -(2**62), 32_767, -32_768
    for _ in range(200):
        raw = random_words(rng, kind, 40, 0.1).astype(unit).view(np.uint8)
        given = rng.choice(extremes, 5 if kind == "evt3" else 1)
        before = np.array([*rng.choice(extremes, 3), 0, rng.choice(extremes)])
        state, seen = given.copy(), before.copy()
        walk(raw, 4, state, seen, np.empty((10, given.size), int), np.empty(10, int))
        columns = [np.zeros(40 * 32 + 1, c) for c in (np.int64, np.int16, np.int16, np.uint8)]
        state, seen = given.copy(), before.copy()
        count, bad = decode(raw, 100, 100, state, seen, 0, *columns)
        if bad < 0:
            assert all(c[:count].min(initial=0) >= 0 and c[:count].max(initial=0) < 100 for c in columns[1:3])


def slowly_shown(before, high, bits):
    """High parts from after `before` to `high`: at the ends and beginnings of wraps, and once in each half of one."""
    half, shown = 2 ** (bits - 1), []
    while before != high:
        end = before | (2 * half - 1)
        before = before + 1 if before == end else min(before + half - 1, end, high)
        shown.append(before)
    return shown


def test_the_high_part_is_written_so_that_no_reader_loses_a_wrap():
    # of three bits: at the beginning and at the end of each wrap, and at least once in each half
    shown = [0, 3, 6, 7, 8, 11, 14, 15, 16, 19, 20]
    assert slowly_shown(-1, 20, 3) == shown
    t = np.array([0, 5, 83, 83, 84])
    assert count_shown(t, -1, 3, 2) == len([0, 1, 4, 7, 8, 11, 14, 15, 16, 19, 20, 21])
    assert count_shown(t[2:], 20, 3, 2) == 1
    assert count_shown(t[:0], -1, 3, 2) == 0
    for bits in (1, 62, -1):
        with pytest.raises(ValueError, match="bits"):
            count_shown(t, -1, bits, 2)
    for encode, low, bits in ((evt2_encode, 6, 28), (evt3_encode, 12, 12)):
        for high in (0, 1, 2 ** (bits - 1), 2**bits - 1, 2**bits, 5 * 2**bits + 7):
            state = np.full(1 if bits == 28 else 3, -1)
            none = np.zeros(1, np.int16)
            words = encode(np.array([high << low]), none, none, none.astype(np.uint8), state)
            times = [word & (2**bits - 1) for word in words.tolist() if word >> bits == 8]
            assert times == [part % 2**bits for part in slowly_shown(-1, high, bits)]
            assert state[0] == high
