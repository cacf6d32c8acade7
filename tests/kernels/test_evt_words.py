"""Random words of EVT 2, 2.1 and 3 against a slow decoder, and the words of time that are written."""

from itertools import pairwise

import numpy as np
import pytest

from nvsdata.kernels.decode.clock import first_time, is_jump, nearest
from nvsdata.kernels.evt import UNSEEN, count_shown, ones, shown_next
from nvsdata.kernels.evt2 import evt2_decode, evt2_highs, evt2_walk
from nvsdata.kernels.evt3 import evt3_count, evt3_decode, evt3_highs, evt3_walk
from nvsdata.kernels.evt21 import evt21_count, evt21_decode, evt21_walk

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
            now = int(nearest(raw, high >> shift, bits) if high >= 0 else first_time(raw, bits)) << shift
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
        for size in ((0, 0), (1_000, 1_500), *ends):
            state, seen = np.array([-1, 0, 0, 0, 0][: len(states[0])]), np.array(UNSEEN)
            columns = [np.zeros(len(events) + 3, c) for c in (np.int64, np.int16, np.int16, np.uint8)]
            kept, start = 1, 0
            limit = size if size[0] else (2_048 if kind == "evt2" else FAR, 2_048)
            for raw in raws:
                count, bad = decode(raw, *size, state, seen, kept, *columns)
                length = raw.size // unit.itemsize
                part = [e for e in events if start <= e[0] < start + length]
                outside = [e[0] - start for e in part if e[2] >= limit[0] or e[3] >= limit[1]]
                assert (count, bad) == (len(part), outside[0] if outside else -1)
                kept, start = kept + count, start + length
            assert list(zip(*(c[1:kept].tolist() for c in columns), strict=True)) == [e[1:] for e in events]
            assert state.tolist() == states[-1]
            assert seen[[3, 4]].tolist() == [n, jump]


def test_events_and_words_of_time_are_counted():
    rng = np.random.default_rng(4)
    for count, kind in ((evt21_count, "evt2.1"), (evt3_count, "evt3")):
        words = random_words(rng, kind, 200, 0).astype(KERNELS[kind][2])
        # with a time before all, every event counts
        first = np.array([8 << 28 if kind == "evt2.1" else 8 << 12], words.dtype)
        assert count(words.view(np.uint8)) == len(slow(kind, np.concatenate((first, words)))[1])
    for highs, kind, code, bits in ((evt2_highs, "evt2", 28, 28), (evt3_highs, "evt3", 12, 12)):
        words = random_words(rng, kind, 200, 0).astype(KERNELS[kind][2])
        found, parts = highs(words if kind == "evt2" else words.view(np.uint8))
        expected = [i for i, word in enumerate(words.tolist()) if word >> code == 8]
        assert found.tolist() == expected
        assert parts.tolist() == [int(words[i]) & (2**bits - 1) for i in expected]
    for word in (0, 1, 2**32 - 1, 0x80000000, 0x12345678, *rng.integers(0, 2**32, 50).tolist()):
        assert ones(word) == word.bit_count()


def test_the_high_part_is_written_so_that_no_reader_loses_a_wrap():
    # of three bits: at the beginning and at the end of each wrap, and at least once in each half
    shown = [0, 3, 6, 7, 8, 11, 14, 15, 16, 19, 20]
    before = -1
    for expected in shown:
        before = shown_next(before, 20, 3)
        assert before == expected
    assert shown_next(-1, 20, 3) == 0
    assert shown_next(20, 21, 3) == 21
    t = np.array([0, 5, 83, 83, 84])
    assert count_shown(t, -1, 3, 2) == len([0, 1, 4, 7, 8, 11, 14, 15, 16, 19, 20, 21])
    assert count_shown(t[2:], 20, 3, 2) == 1
    assert count_shown(t[:0], -1, 3, 2) == 0
