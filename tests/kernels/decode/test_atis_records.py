"""Records of ATIS files against a slow decoder, piece by piece."""

from itertools import pairwise

import numpy as np
import pytest

from nvsdata.kernels.decode.atis import ATIS_BEGUN, atis_decode, atis_walk

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
@pytest.mark.parametrize("size", [(32_767, 32_767), (256, 256), (200, 256), (200, 150)])
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
            kind == "event" and (x >= width or y >= height)
            for (_, _, kind), (x, y, *_) in zip(rows, records.tolist(), strict=True)
        ]
        for part, first in zip((outside[:cut], outside[cut:]), bad, strict=True):
            assert first == (part.index(True) if True in part else -1)
