"""Records of ATIS and Prophesee's .dat files against slow decoders, piece by piece."""

from itertools import pairwise

import numpy as np
import pytest

from nvsdata.kernels.atis import ATIS_BEGUN, atis_decode, atis_walk
from nvsdata.kernels.dat import dat_decode
from nvsdata.kernels.decode.clock import FELL, LAST, NEXT, UNKNOWN, clock_at, nearest

OVERFLOW = 240  # y of a record that adds 2^13 µs; those above it are damage


def atis_records(rng, n, kind):
    """Random records, uint8 [N, 5]: without odd ones, with some, or many."""
    records = rng.integers(0, 256, (n, 5)).astype(np.uint8)
    records[:, 1] %= OVERFLOW
    # nearly in order
    records[:, 2:] = np.sort(rng.integers(0, 2**23, n)).astype(">u4").view(np.uint8).reshape(-1, 4)[:, 1:]
    records[:, 2] |= (rng.integers(0, 2, n) << 7).astype(np.uint8)
    if n and kind != "events":
        odd = rng.random(n) < (0.2 if kind == "some" else 0.7)
        records[odd, 1] = rng.choice((OVERFLOW, OVERFLOW, OVERFLOW + 1, 255), n)[odd]
    return records


def slow_atis(records):
    """For each record: its time (that of the event before it if it's none), overflow before it, kind; and events."""
    overflow, last, rows, events = 0, 0, [], []
    for x, y, high, middle, low in records.tolist():
        time = (high & 127) << 16 | middle << 8 | low
        kind = "event" if y < OVERFLOW else "overflow" if y == OVERFLOW else "damage"
        last = time + overflow if kind == "event" else last
        rows.append((last, overflow, kind))
        if kind == "event":
            events.append((last, x, y, high >> 7))
        overflow += 8192 * (kind == "overflow")
    return rows, events, overflow


@pytest.mark.parametrize("kind", ["events", "some", "many"])
def test_a_walk_over_atis_records_sees_what_a_slow_one_does(kind):
    rng = np.random.default_rng(0)
    for n in (0, 1, 2, 3, 7, 16, 30) * 4:
        records = atis_records(rng, n, kind)
        if kind == "some" and n > 7:
            records[:4, 1] = 255, OVERFLOW, 7, 9
        block = int(rng.choice((1, 3, 4, 100)))
        rows, events, overflow = slow_atis(records)
        state = np.array(ATIS_BEGUN)
        times, offsets = np.full(n + 1, -7), np.full((n + 1, 1), -7)
        cut = int(rng.integers(0, n + 1))
        for piece in (records[:cut], records[cut:]):
            atis_walk(piece.ravel(), block, state, times, offsets)
        begun = rows[::block]
        count = len(begun)
        assert offsets[:count, 0].tolist() == [row[1] for row in begun]
        assert times[:count].tolist() == [row[0] for row in begun]
        assert times[count:].tolist() == [-7] * (n + 1 - count)
        kinds = [row[2] for row in rows]
        when = [event[0] for event in events]
        assert state.tolist() == [
            overflow,
            when[-1] if when else 0,
            when[0] if when else 0,
            sum(b < a for a, b in pairwise(when)),
            max((event[1] + 1 for event in events), default=1),
            max((event[2] + 1 for event in events), default=1),
            kinds.count("overflow"),
            n,
            kinds.count("damage"),
            kinds.index("damage") if "damage" in kinds else -1,
        ]


@pytest.mark.parametrize("kind", ["events", "some", "many"])
@pytest.mark.parametrize("size", [(0, 0), (256, 256), (200, 0), (200, 150)])
def test_atis_records_decode_as_a_slow_decoder_does(kind, size):
    rng = np.random.default_rng(1)
    width, height = size
    for n in (0, 1, 2, 5, 9, 600):
        records = atis_records(rng, n, kind)
        state, columns = np.array([0, 0, 0, -1]), [np.zeros(n + 2, c) for c in (np.int64, np.int16, np.int16, np.uint8)]
        rows, events, overflow = slow_atis(records)
        cut, kept, bad = int(rng.integers(0, n + 1)), 1, []
        for piece in (records[:cut], records[cut:]):
            count, first = atis_decode(piece.ravel(), width, height, state, kept, *columns)
            kept += count
            bad.append(first)
        assert list(zip(*(column[1:kept].tolist() for column in columns), strict=True)) == events
        kinds = [row[2] for row in rows]
        damage = kinds.index("damage") if "damage" in kinds else -1
        assert state.tolist() == [overflow, n, kinds.count("damage"), damage]
        outside = [
            kind == "event" and width > 0 and (x >= width or y >= (height or OVERFLOW))
            for (_, _, kind), (x, y, *_) in zip(rows, records.tolist(), strict=True)
        ]
        for part, first in zip((outside[:cut], outside[cut:]), bad, strict=True):
            assert first == (part.index(True) if True in part else -1)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("size", [(0, 0), (304, 240), (1, 1)])
def test_dat_records_decode_as_a_slow_decoder_does(version, size):
    rng = np.random.default_rng(2)
    for n in (0, 1, 2, 3, 8, 20) * 5:
        last = int(rng.choice((0, 90_000, 2**32 - 30, 2**31 + 5, 3 * 2**32 - 9)))
        t = last + np.cumsum(rng.choice((0, 1, 9, 40, -4), n, p=(0.2, 0.4, 0.2, 0.1, 0.1)))
        t = np.sort(t) if rng.random() < 0.7 else t
        x, y, p = rng.integers(0, size[0] or 304, n), rng.integers(0, size[1] or 240, n), rng.integers(0, 2, n)
        if n and rng.random() < 0.4:
            at = rng.integers(n)
            x[at], y[at] = ((size[0], 0), (0, size[1]), (304, 239))[rng.integers(3)]
        if version == 1:
            y = y & 0xFF
            address = p << 17 | y << 9 | x
        else:
            address = p << 28 | y << 14 | x | rng.choice((0, 1 << 29, 1 << 31), n)
        raw = np.stack([t % 2**32, address], 1).astype("<u4").view(np.uint8).ravel()
        # a first word in the first wrap needs no time before it
        known = last > 2**31 or n == 0 or t[0] < last
        state, columns = (
            clock_at(last if known else UNKNOWN, 50),
            [np.zeros(n + 2, c) for c in (np.int64, np.int16, np.int16, np.uint8)],
        )
        found = dat_decode(raw, 4, version, *size, state, 1, *columns)
        outside = (size[0] > 0) & ((x >= size[0]) | (y >= size[1]))
        assert found == (n, int(outside.argmax()) if outside.any() else -1)
        when = []
        for word in (t % 2**32).tolist():
            when.append(int(nearest(word, when[-1] if when else last, 32)))
        assert [column[1 : n + 1].tolist() for column in columns] == [when, x.tolist(), y.tolist(), p.tolist()]
        falls = any(b < a for a, b in pairwise([last, *when]))
        assert state[[LAST, NEXT, FELL]].tolist() == [when[-1] if when else last, 50 + n, falls]
        assert [column[-1] for column in columns] == [0] * 4
