"""Records of a packed store against a slow reference: the events that went in, cut by masks."""

import struct
import tracemalloc
import zlib
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsdata.data.events import EVER, LATEST, MAX_COORDINATE, Columns
from nvsdata.datasets.store import record
from nvsdata.datasets.store.record import ALIGNED, BLOCK, HEAD, BlockError, events_of, head_of, record_of
from nvsdata.kernels.decode.blocks import blocks_between, crc32c

LARGEST = MAX_COORDINATE + 1  # pixels
SIZES = [(1, 1), (34, 34), (256, 256), (257, 1), (1, 257), (1280, 720), (LARGEST, LARGEST)]
UNSTATED = (None, None)
both = pytest.mark.parametrize("compress", [False, True])


def events(n, size=(34, 34), first=0, most_gap=20, seed=0):
    """Events in order, with equal times, in the corners of their sensor too."""
    rng = np.random.default_rng(seed)
    t = first + np.cumsum(rng.integers(0, most_gap + 1, n))
    x, y = (rng.integers(0, side, n) for side in size)
    at = rng.integers(0, n, 2)
    x[at], y[at] = (0, size[0] - 1), (size[1] - 1, 0)
    return Columns(t, x.astype(np.int16), y.astype(np.int16), rng.integers(0, 2, n).astype(np.uint8))


def read(raw, start, stop):
    """Events of a record with start <= t < stop, of only the blocks that may have some."""
    raw = np.frombuffer(raw, np.uint8)
    head = head_of(raw, raw.size)
    first, last, begin, end, most = blocks_between(head.table, head.span[0], start, stop)
    return events_of(head, first, last, raw[head.bytes + begin : head.bytes + end], start, stop, most)


def cut(columns, start, stop):
    inside = [start <= time < stop for time in columns.t.tolist()]
    return Columns(*(column[inside] for column in columns))


def same(one, other):
    for a, b, kind in zip(one, other, (np.int64, np.int16, np.int16, np.uint8), strict=True):
        assert a.dtype == kind
        assert np.array_equal(a, b)


def check(columns, size, windows, compress, time=UNSTATED):
    """Fail unless a record holds these events, in these windows and in total."""
    raw = record_of(columns, size, time, "evt3", compress=compress)
    assert len(raw) % ALIGNED == 0
    head = head_of(np.frombuffer(raw, np.uint8), len(raw))
    assert head.span == (columns.t[0], columns.t[-1])
    assert (head.size, head.time, head.format) == (size, time, "evt3")
    assert head.widths[0] == (4 if head.span[1] - head.span[0] < 2**32 else 8)
    assert head.widths[1] == (1 if max(size) <= 256 else 2)
    assert head.blocks["events"].sum() == columns.t.size
    assert head.blocks["events"].max() <= record.MOST_EVENTS
    same(read(raw, *EVER), columns)
    for start, stop in windows:
        same(read(raw, start, stop), cut(columns, start, stop))
    return head


def windows_of(t, rng, count=20):
    """Windows with edges at events, right beside them, anywhere, and far away."""
    edges = [*rng.choice(t, count).tolist(), *(rng.choice(t, count) + rng.integers(-1, 2, count)).tolist()]
    edges += [*EVER, int(t[0]), int(t[-1]), int(t[-1]) + 1]
    return [tuple(sorted(rng.choice(len(edges), 2).tolist())) for _ in range(count)], edges


@both
@given(
    n=st.integers(1, 90),
    block=st.sampled_from((1, 2, 3, 7, 16, 64, 1 << 16)),
    size=st.sampled_from(SIZES),
    gap=st.sampled_from((0, 1, 5, 3_000, 2**31, 2**40)),
    first=st.sampled_from((0, 1, -1, -(10**15), 2**32, 2**53, -LATEST + 1)),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_window_has_the_events_that_went_in(compress, n, block, size, gap, first, seed):
    columns = events(n, size, first, gap, seed)
    pairs, edges = windows_of(columns.t, np.random.default_rng(seed))
    windows = [tuple(sorted((edges[a], edges[b]))) for a, b in pairs]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(record, "MOST_EVENTS", block)
        head = check(columns, size, windows, compress)
    assert head.blocks.size == -(-n // block)


@both
@pytest.mark.parametrize("n", [1, 65_535, 65_536, 65_537, 131_072, 150_000])
def test_blocks_of_their_full_size(compress, n):
    columns = events(n, (346, 260), 10**9)
    rng = np.random.default_rng(n)
    t, at = columns.t, rng.integers(0, n, (8, 2))
    windows = [tuple(sorted(pair)) for pair in t[at].tolist()]
    for border in range(0, n, record.MOST_EVENTS):
        before, time = int(t[border - 1]), int(t[border])
        windows += [(time, time + 1), (before, time), (before, time + 1), (time, EVER[1]), (EVER[0], time)]
    windows = [(start, stop) for start, stop in windows if start <= stop]
    head = check(columns, (346, 260), windows, compress)
    assert head.compressed == compress


@both
def test_equal_times_at_the_borders_of_blocks_belong_together(compress, monkeypatch):
    monkeypatch.setattr(record, "MOST_EVENTS", 4)
    for t in ([5] * 12, [1, 2, 3, 5, 5, 5, 5, 5, 5, 8], [5, 5, 5, 5, 6, 6, 6, 6, 7], [0, 0, 0, 9, 9, 10]):
        columns = events(len(t))._replace(t=np.array(t, np.int64))
        edges = sorted({time + step for time in t for step in (-1, 0, 1)})
        check(columns, (34, 34), [(a, b) for a in edges for b in edges if a <= b], compress)


@both
@pytest.mark.parametrize("time", [-LATEST + 1, -1, 0, 2**32, LATEST - 1])
def test_one_event(compress, time):
    columns = events(1)._replace(t=np.array([time]))
    windows = [(time, time + 1), (time - 1, time), (time + 1, time + 2), (time, time), EVER]
    head = check(columns, (34, 34), windows, compress)
    assert head.widths[0] == 4


@both
@pytest.mark.parametrize("length", [2**32 - 1, 2**32, 2**33 + 5, 2 * LATEST - 2])
def test_times_far_apart(compress, length, monkeypatch):
    monkeypatch.setattr(record, "MOST_EVENTS", 3)
    first = -LATEST + 1 if length > LATEST else -7
    steps = [0, 0, 1, length // 2, length // 2, length // 2 + 1, length - 1, length, length]
    columns = events(len(steps))._replace(t=np.array([first + step for step in steps], np.int64))
    edges = sorted({first + step + more for step in steps for more in (-1, 0, 1)})
    head = check(columns, (34, 34), [(a, b) for a in edges for b in edges if a <= b], compress)
    assert head.widths[0] == (4 if length < 2**32 else 8)


@both
@pytest.mark.parametrize("time", [(-5, 10**6), (0, 10**6), (-LATEST + 1, LATEST - 1), UNSTATED])
def test_the_stated_beginning_and_end_are_kept(compress, time):
    check(events(50), (34, 34), [(0, 100)], compress, time)


@both
@pytest.mark.parametrize("size", [(LARGEST, 1), (1, LARGEST), (LARGEST, LARGEST), (256, 256), (257, 257)])
def test_the_farthest_pixels_are_kept(compress, size):
    columns = events(40, size)
    assert (columns.x.max(), columns.y.max()) == (size[0] - 1, size[1] - 1)
    check(columns, size, [(0, 100)], compress)


def test_a_record_is_the_same_each_time_and_smaller_if_compressed():
    columns = events(20_000)
    plain, packed = (record_of(columns, (34, 34), UNSTATED, "atis", compress=compress) for compress in (False, True))
    assert plain == record_of(columns, (34, 34), UNSTATED, "atis", compress=False)
    assert packed == record_of(columns, (34, 34), UNSTATED, "atis", compress=True)
    assert len(plain) == HEAD.size + BLOCK.itemsize + 20_000 * 7
    assert len(packed) < 0.8 * len(plain)


def test_blocks_that_would_compress_too_well_are_stored_as_they_are(monkeypatch):
    alike = Columns(np.zeros(60_000, np.int64), *np.zeros((2, 60_000), np.int16), np.zeros(60_000, np.uint8))
    assert not check(alike, (34, 34), [(0, 1), (1, 2)], True).compressed
    # and all blocks of a recording, if one of them is
    monkeypatch.setattr(record, "MOST_EVENTS", 60_000)
    various = events(60_000, first=1)
    mixed = Columns(*(np.concatenate(pair) for pair in zip(alike, various, strict=True)))
    assert not check(mixed, (34, 34), [(0, 1), (0, 100)], True).compressed
    assert check(various, (34, 34), [(0, 100)], True).compressed


def altered(raw, inflated, block=0, **fields):
    """A record with other bytes in a compressed block, with right checksums and sizes."""
    head = list(HEAD.unpack_from(raw))
    table = np.frombuffer(raw, BLOCK, head[1], HEAD.size).copy()
    ends = [0, *np.cumsum(table["bytes"]).tolist()]
    body = raw[HEAD.size + table.nbytes :]
    blocks = [body[a:b] for a, b in pairwise(ends)]
    blocks[block] = inflated(blocks[block])
    table["bytes"][block], table["check"][block] = len(blocks[block]), crc32c(np.frombuffer(blocks[block], np.uint8))
    for name, value in fields.items():
        table[name][block] = value
    rest = HEAD.pack(*head)[4:] + table.tobytes()
    whole = struct.pack("<I", crc32c(np.frombuffer(rest, np.uint8))) + rest + b"".join(blocks)
    return whole + bytes(-len(whole) % ALIGNED)


CHANGES = {
    "one byte more": lambda block: zlib.compress(zlib.decompress(block) + b"\0"),
    "one byte less": lambda block: zlib.compress(zlib.decompress(block)[:-1]),
    "nothing": lambda block: zlib.compress(b"") + bytes(len(block)),
    "200 MB": lambda block: zlib.compress(zlib.decompress(block) + bytes(200_000_000)),
    "200 MB of zeros": lambda block: zlib.compress(bytes(200_000_000)),
    "cut": lambda block: block[: len(block) * 3 // 4],
    "another checksum": lambda block: block[:-1] + bytes([block[-1] ^ 1]),
    "no deflate": lambda block: bytes(255 - byte for byte in block),
    "zeros": lambda block: bytes(len(block)),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("block", [0, 2])
def test_a_compressed_block_of_another_length_is_an_error_and_takes_no_memory(change, block, monkeypatch):
    monkeypatch.setattr(record, "MOST_EVENTS", 2_000)
    raw = record_of(events(5_000), (34, 34), UNSTATED, "atis", compress=True)
    # unchanged otherwise
    assert altered(raw, lambda block: block) == raw
    raw = altered(raw, CHANGES[change], block)
    tracemalloc.start()
    try:
        with pytest.raises(BlockError) as caught:
            read(raw, *EVER)
        assert tracemalloc.get_traced_memory()[1] < 2_000_000
    finally:
        tracemalloc.stop()
    assert caught.value.block == block
    # blocks before it are fine
    if block:
        same(read(raw, 0, 100), cut(events(5_000), 0, 100))


def test_a_block_of_one_event_that_inflates_to_more_is_an_error(monkeypatch):
    raw = record_of(events(1), (34, 34), UNSTATED, "atis", compress=True)
    for more in (1, 200_000_000):
        with pytest.raises(BlockError):
            read(altered(raw, lambda block, more=more: zlib.compress(zlib.decompress(block) + bytes(more))), *EVER)


def test_a_block_whose_events_begin_at_another_time_than_its_table_says_is_an_error(monkeypatch):
    monkeypatch.setattr(record, "MOST_EVENTS", 50)
    raw = record_of(events(200, most_gap=9), (34, 34), UNSTATED, "atis", compress=False)
    first = int(np.frombuffer(raw, BLOCK, 4, HEAD.size)["first"][2])
    after = HEAD.unpack_from(raw)[3] + first + 5
    for other in (first - 1, first + 1):
        changed = altered(raw, bytes, 2, first=other)
        # those that read the block
        for window in (EVER, (after, EVER[1]), (after, after + 1)):
            with pytest.raises(BlockError):
                read(changed, *window)


def test_a_compressed_block_begins_when_its_table_says(monkeypatch):
    """Its times are relative to that: another time gives other events, in all windows."""
    monkeypatch.setattr(record, "MOST_EVENTS", 50)
    columns = events(200, most_gap=9)._replace(t=np.arange(200, dtype=np.int64) * 10)
    raw = record_of(columns, (34, 34), UNSTATED, "atis", compress=True)
    changed = altered(raw, bytes, 2, first=1_003)
    moved = columns._replace(t=columns.t + 3 * (np.arange(200) // 50 == 2))
    for window in (EVER, (1_000, 1_003), (1_003, 1_004), (1_400, 1_600), (0, 1_003)):
        same(read(changed, *window), cut(moved, *window))


@both
def test_a_changed_bit_of_a_record_is_an_error(compress, monkeypatch):
    monkeypatch.setattr(record, "MOST_EVENTS", 20)
    columns = events(60)
    raw = record_of(columns, (34, 34), UNSTATED, "atis", compress=compress)
    padding = len(raw) - HEAD.size - 3 * BLOCK.itemsize
    padding -= int(np.frombuffer(raw, BLOCK, 3, HEAD.size)["bytes"].sum())
    for at in range(8 * (len(raw) - padding)):
        flipped = bytearray(raw)
        flipped[at // 8] ^= 1 << at % 8
        with pytest.raises(ValueError, match=r"recording|checksum"):
            read(bytes(flipped), *EVER)


@both
def test_a_record_that_is_cut_is_an_error(compress):
    raw = np.frombuffer(record_of(events(40), (34, 34), UNSTATED, "atis", compress=compress), np.uint8)
    for size in range(raw.size - ALIGNED):
        with pytest.raises(ValueError, match="recording"):
            head_of(raw[:size], size)
