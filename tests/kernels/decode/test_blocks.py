"""Blocks of a packed store, by their definition."""

import struct

import numpy as np
import pytest

from nvsdata.data.events import Columns
from nvsdata.kernels.decode.blocks import FAULTS, blocks_between, crc32c, record_head, unpack_blocks

EVER = -(1 << 63), (1 << 63) - 1
SIZE = 200, 150


def crc_by_bits(raw):
    value = 0xFFFFFFFF
    for byte in bytes(raw):
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)
    return ~value & 0xFFFFFFFF


def test_checksums_are_those_of_the_standard():
    # RFC 3720, B.4, and the check value of the catalog of CRC algorithms
    ascending = np.arange(32, dtype=np.uint8)
    assert crc32c(np.zeros(32, np.uint8)) == 0x8A9136AA
    assert crc32c(np.full(32, 255, np.uint8)) == 0x62A8AB43
    assert crc32c(ascending) == 0x46DD794E
    assert crc32c(ascending[::-1].copy()) == 0x113FDB5C
    assert crc32c(np.frombuffer(b"123456789", np.uint8)) == 0xE3069283
    assert crc32c(np.zeros(0, np.uint8)) == 0


# three lanes of 1,024 bytes, words of 8
@pytest.mark.parametrize("size", [1, 7, 8, 9, 3071, 3072, 3073, 3080, 6144, 10_007])
def test_checksums_of_any_length(size):
    raw = np.random.default_rng(size).integers(0, 256, size).astype(np.uint8)
    assert crc32c(raw) == crc_by_bits(raw)
    assert crc32c(raw[::2]) == crc_by_bits(raw[::2])


def events(count, seed=0):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 1_000, count))
    return t, rng.integers(0, SIZE[0], count), rng.integers(0, SIZE[1], count), rng.integers(0, 2, count)


def packed(columns, counts, t="u4", xy="u1"):
    """Blocks of events: their bytes and their table."""
    blocks, table, at = [], b"", 0
    for count in counts:
        kinds = (t, xy, xy, "u1")
        parts = [column[at : at + count].astype(kind).tobytes() for column, kind in zip(columns, kinds, strict=True)]
        blocks.append(b"".join(parts))
        first = int(columns[0][min(at, len(columns[0]) - 1)])
        table += struct.pack("<qIIII", first, count, len(blocks[-1]), crc_by_bits(blocks[-1]), 0)
        at += count
    return np.frombuffer(b"".join(blocks), np.uint8), np.frombuffer(table, np.uint8)


def unpacked(raw, table, *, base=0, window=EVER, t="u4", xy="u1", size=SIZE, check=True):
    out = Columns.empty(300)
    widths = np.dtype(t).itemsize, np.dtype(xy).itemsize
    found, fault = unpack_blocks(*out, base, *window, raw, table, check, *widths, *size)
    return out.first(found), fault


@pytest.mark.parametrize("counts", [(300,), (100, 200), (1, 298, 1), (0, 300, 0), (150, 0, 150)])
@pytest.mark.parametrize(("t", "xy"), [("u4", "u1"), ("i8", "u1"), ("u4", "u2"), ("i8", "u2")])
@pytest.mark.parametrize("window", [EVER, (0, 0), (5, 4), (-9, 3), (117, 118), (100, 620), (0, 1_000), (999, 2_000)])
def test_windows_of_blocks_are_those_of_the_events(counts, t, xy, window):
    columns, base = events(300), -40
    found, fault = unpacked(*packed(columns, counts, t, xy), base=base, window=window, t=t, xy=xy)
    chosen = (columns[0] + base >= window[0]) & (columns[0] + base < window[1])
    assert fault == 0
    assert [part.tolist() for part in found] == [
        (column + shift)[chosen].tolist() for column, shift in zip(columns, (base, 0, 0, 0), strict=True)
    ]


def test_a_changed_byte_anywhere_is_found():
    counts = (40, 30)
    raw, table = packed(events(70), counts)
    for byte in range(raw.size):
        changed = raw.copy()
        changed[byte] ^= 1 << (byte % 8)
        _, fault = unpacked(changed, table)
        assert divmod(fault - 1, 4) == (int(byte >= 40 * 7), FAULTS.index("its events fail their checksum"))


@pytest.mark.parametrize(
    ("column", "value", "fault"), [(0, 0, 2), (1, SIZE[0], 1), (2, SIZE[1], 1), (3, 2, 1), (1, 255, 1)]
)
@pytest.mark.parametrize("at", [1, 40, 45, 69])
def test_impossible_events_are_found_with_a_right_checksum(column, value, fault, at):
    columns = [part + (n == 0) for n, part in enumerate(events(70))]
    # the table has the first time of a block
    columns[column][at] = value
    raw, table = packed(columns, (40, 30))
    for check in (True, False):
        assert divmod(unpacked(raw, table, check=check)[1] - 1, 4) == (int(at >= 40), fault)
    assert unpacked(raw, table, size=(300, 300))[1] == 0 or column in (0, 3)


def test_a_table_with_other_times_is_found():
    raw, table = packed(events(70), (40, 30))
    for block in (0, 1):
        other = table.copy().view("<i8")
        other[3 * block] += 1
        assert divmod(unpacked(raw, other.view(np.uint8))[1] - 1, 4) == (block, 3)


def test_arrays_that_contradict_each_other_are_refused():
    raw, table = packed(events(70), (40, 30))
    out = Columns.empty(70)
    for wrong in (
        (raw[:-1], table, True, 4, 1),
        (raw, table[:24], True, 4, 1),
        (raw, table, True, 5, 1),
        (raw, table, True, 4, 3),
    ):
        with pytest.raises(ValueError, match="unpack_blocks"):
            unpack_blocks(*out, 0, *EVER, *wrong, *SIZE)
    with pytest.raises(ValueError, match="columns are too short"):
        unpack_blocks(*out.first(69), 0, *EVER, raw, table, True, 4, 1, *SIZE)


@pytest.mark.parametrize("firsts", [(0,), (0, 5, 9), (0, 5, 5, 5, 9), (0, 0, 0)])
@pytest.mark.parametrize("base", [0, -1_000, 1 << 61])
def test_blocks_of_a_window_are_all_that_may_have_its_events(firsts, base):
    table = np.frombuffer(b"".join(struct.pack("<qIIII", t, 2, 10 + n, 0, 0) for n, t in enumerate(firsts)), np.uint8)
    for start in range(-2, 12):
        for stop in range(start, 13):
            first, last, begin, end, count = blocks_between(table, base, base + start, base + stop)
            # block n has times from its first one to that of the next block
            may = [n for n, t in enumerate(firsts) if t < stop and (n + 1 == len(firsts) or firsts[n + 1] >= start)]
            assert list(range(first, last)) == may or (not may and last <= first) or stop == start
            assert (begin, end) == (sum(10 + n for n in range(first)), sum(10 + n for n in range(max(last, first))))
            assert count == 2 * max(last - first, 0)


def record(counts=(2, 1), **changes):
    """Head and table of a record with a right checksum, and the bytes of its blocks."""
    given = {"blocks": len(counts), "events": sum(counts), "base": 7, "duration": 50, "begin": 0, "end": 90}
    given |= {"width": 34, "height": 30, "t": 4, "xy": 1, "compressed": 0} | changes
    first = given.pop("first", range(0, 10 * len(counts), 10))
    lengths = given.pop("lengths", [7 * count for count in counts])
    rows = [struct.pack("<qIIII", *row, 0, 0) for row in zip(first, counts, lengths, strict=True)]
    rest = struct.pack("<IQqqqqHHBBBx16s", *given.values(), b"atis") + b"".join(rows)
    return np.frombuffer(struct.pack("<I", crc_by_bits(rest)) + rest, np.uint8), sum(lengths)


def test_a_head_says_what_was_written():
    raw, length = record()
    assert record_head(raw, raw.size + length) == (0, 2, 7, 50, 0, 90, 34, 30, 4, 1, 0)
    # what follows is of another record
    assert record_head(np.append(raw, raw), raw.size + length)[0] == 0
    assert record_head(raw[:-1], raw.size + length)[0] == record_head(raw, raw.size - 1)[0] == 1
    assert record_head(raw[:71], raw.size + length)[0] == 1
    for byte in range(raw.size):
        changed = raw.copy()
        changed[byte] ^= 64
        assert record_head(changed, raw.size + length)[0] in (1, 2)


@pytest.mark.parametrize(
    "changes",
    [
        {"events": 4},
        {"counts": (), "first": (), "lengths": (), "events": 0},
        {"counts": (2, 0), "lengths": (14, 0)},
        {"counts": ((1 << 16) + 1,)},
        {"base": 1 << 62},
        {"base": -(1 << 62)},
        {"duration": -1},
        {"duration": (1 << 62) - 7},
        {"duration": 9},
        {"begin": 8},
        {"end": 56},
        {"end": -(1 << 63)},
        {"begin": -(1 << 63)},
        {"end": 1 << 62},
        {"width": 0},
        {"height": 0},
        {"width": 32_768},
        {"t": 5},
        {"xy": 0},
        {"xy": 4},
        {"compressed": 2},
        {"first": (1, 10)},
        {"first": (0, -1)},
        {"counts": (2, 1, 1), "first": (0, 20, 10)},
        {"lengths": (14, 8)},
        {"lengths": (7, 14)},
        {"compressed": 1, "counts": (1_000,), "lengths": (69,)},
    ],
)
def test_a_head_that_states_what_can_not_be_is_refused(changes):
    raw, length = record(**changes)
    assert record_head(raw, raw.size + length)[0] == 3


def test_a_record_has_no_more_room_than_its_blocks_need():
    raw, length = record()
    rooms = {room: record_head(raw, raw.size + room)[0] for room in range(length - 3, length + 12)}
    assert rooms == {room: 0 if length <= room < length + 8 else 3 for room in rooms}
    compressed, _ = record(counts=(1_000,), lengths=(70,), compressed=1)
    assert record_head(compressed, compressed.size + 70)[0] == 0
