"""The bytes of a store's file: as docs/dev/store.md describes them, and which values they may have."""

from __future__ import annotations

import os
import struct
import zlib
from itertools import chain

import numpy as np
import pytest
import storefiles
import trees
from distributions import check_same

import nvsdata
from nvsdata import EventFolder, Events, FormatError
from nvsdata.datasets.source import Folder
from nvsdata.datasets.store import index, record, writing
from nvsdata.datasets.store import writer as packing
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.writer import pack

LONG = 2**32 - 1  # µs that 32 bits can count
LATEST = 2**62 - 1  # µs


def store_of(folder, *recordings, **options):
    """A store of these recordings, in one class."""
    (folder / "data/a").mkdir(parents=True)
    for number, events in enumerate(recordings):
        nvsdata.write(events, folder / f"data/a/{number}.h5")
    report = pack(EventFolder(folder / "data"), folder / "a.nvs", **options)
    assert (report.packed, report.events) == (len(recordings), sum(map(len, recordings)))
    store = EventFolder(folder / "a.nvs")
    assert [store[number][0] for number in range(len(store))] == list(recordings)
    return folder / "a.nvs"


def widths(path, number=0):
    head = storefiles.head_at(path, number)[1]
    return head["t_bytes"], head["xy_bytes"]


def crc32c(raw):
    """CRC-32C, bit by bit."""
    value = 0xFFFFFFFF
    for byte in raw:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)
    return value ^ 0xFFFFFFFF


def columns_of(block, count, first, compressed):
    """Times, x, y and polarities of a block of uint32 times and bytes."""
    if not compressed:
        t, x, y, p = (block[begin * count : end * count] for begin, end in ((0, 4), (4, 5), (5, 6), (6, 7)))
        return np.frombuffer(t, "<u4").tolist(), list(x), list(y), list(p)
    block = zlib.decompress(block)
    planes = np.frombuffer(block[: 4 * count], np.uint8).reshape(4, count).astype(int)
    steps = planes[0] + (planes[1] << 8) + (planes[2] << 16) + (planes[3] << 24)
    p = [block[6 * count + i // 8] >> (7 - i % 8) & 1 for i in range(count)]
    assert len(block) == 6 * count + -(-count // 8)
    return (first + np.cumsum(steps)).tolist(), list(block[4 * count : 5 * count]), list(block[5 * count :][:count]), p


@pytest.mark.parametrize("compress", [False, True])
def test_a_file_is_as_described(tmp_path, monkeypatch, compress):
    monkeypatch.setattr(record, "MOST_EVENTS", 100)
    recordings = [trees.some(seed, n, first=100) for seed, n in enumerate((1, 99, 100, 101, 250))]
    path = store_of(tmp_path, *recordings, compress=compress)
    raw = path.read_bytes()
    magic, version, check, at, length, of_index = struct.unpack_from("<8sIIQQI", raw)
    assert (magic, version, check, of_index) == (b"NVSSTORE", 3, crc32c(raw[16:64]), crc32c(raw[at:]))
    assert at + length == len(raw)
    assert raw[36:64] == bytes(28)

    sizes = struct.unpack_from("<14Q", raw, at)
    begins = at + 112 + np.cumsum([0, *(size + -size % 8 for size in sizes)])
    assert begins[-1] == len(raw)
    facts, place, of_file, checks, *texts, file_end, file_data, labels, positions, parts = (
        raw[begin : begin + size] for begin, size in zip(begins, sizes, strict=False)
    )
    assert facts == b'{"dataset": "event-folder", "split": "all", "fold": 0}' or facts.startswith(b'{"dataset": ')
    assert np.frombuffer(of_file, "<u8").tolist() == [(tmp_path / f"data/a/{n}.h5").stat().st_size for n in range(5)]
    names = b"".join(b"a/%d.h5\0" % n for n in range(5))
    assert texts == [names, b".\0a\0", b"", b"", b""]
    assert (file_end, file_data) == (labels, positions) == (b"", b"")
    assert parts == b""

    place = np.frombuffer(place, "<u8").tolist()
    assert checks == b"".join(raw[begin : begin + 4] for begin in place[:-1])
    assert (place[0], place[-1], [begin % 8 for begin in place]) == (64, at, [0] * 6)
    for events, begin, end in zip(recordings, place[:-1], place[1:], strict=True):
        check, blocks, count, base, duration, start, stop, *kind, name = struct.unpack_from(
            "<IIQqqqqHHBBBB16s", raw, begin
        )
        table = np.frombuffer(raw, "<i8, <u4, <u4, <u4, <u4", blocks, begin + 72).tolist()
        assert check == crc32c(raw[begin + 4 : begin + 72 + 24 * blocks])
        assert (blocks, count, base, duration) == (
            -(-len(events) // 100),
            len(events),
            events.t[0],
            events.t[-1] - events.t[0],
        )
        assert (start, stop) == (events.start, events.stated_end if events.stated_end is not None else stop)
        assert (kind, name.rstrip(b"\0")) == ([34, 34, 4, 1, int(compress), 0], b"hdf5")
        found, byte = [], begin + 72 + 24 * blocks
        for first, number, size, of_block, zero in table:
            assert (of_block, zero) == (crc32c(raw[byte : byte + size]), 0)
            found.append(columns_of(raw[byte : byte + size], number, first, compress))
            assert found[-1][0][0] == first
            byte += size
        assert [len(block[0]) for block in found] == [100] * (blocks - 1) + [len(events) - 100 * (blocks - 1)]
        t, x, y, p = (list(chain.from_iterable(column)) for column in zip(*found, strict=True))
        assert (np.array(t) + base).tolist() == events.t.tolist()
        assert (x, y, p) == (events.x.tolist(), events.y.tolist(), events.p.tolist())
        assert raw[byte:end] == bytes(-byte % 8)
    store = Store(path)
    assert [store.size(name) for name in store.names] == [
        (tmp_path / "data" / name).stat().st_size for name in store.names
    ]
    assert len({store.stamp(name) for name in store.names}) == 5
    assert store.stamp(store.names[1]) == (struct.unpack_from("<I", raw, place[1])[0], place[2] - place[1])
    assert store.settled(store.names[0], 0)


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("gap", [1, 2, 3_000])
def test_windows_around_every_border_of_blocks(tmp_path, monkeypatch, compress, gap):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    rng = np.random.default_rng(0)
    # with a gap of 1 or 2, many events have the same time, also across borders
    t = 50 + np.cumsum(rng.integers(0, gap + 1, 200) * (rng.integers(0, 20, 200) == 0))
    events = Events(t, rng.integers(0, 34, 200), rng.integers(0, 34, 200), rng.integers(0, 2, 200), (34, 34))
    path = store_of(tmp_path, trees.some(2, 40), events, compress=compress)
    assert storefiles.head_at(path, 1)[1]["blocks"] == 13
    recording = EventFolder(path).recording(1)
    for place in (*range(0, 200, 16), *range(15, 200, 16), 199):
        for shift in (-1, 0, 1):
            moment = int(events.t[place]) + shift
            windows = ((moment, None), (None, moment), (moment, moment + 1), (moment, moment), (moment - 9, moment + 9))
            for start, stop in windows:
                assert recording.read(start, stop) == events.window(start, stop)


@pytest.mark.parametrize("compress", [False, True])
def test_a_window_reads_its_blocks_only(tmp_path, monkeypatch, compress):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    events = trees.some(1, 200)
    path = store_of(tmp_path, events, compress=compress)
    monkeypatch.setattr("nvsdata.datasets.store.reader.AT_ONCE", 72)
    recording = EventFolder(path).recording(0)
    begins = storefiles.block_places(path, 0)
    real, asked = Store._bytes, []
    monkeypatch.setattr(Store, "_bytes", lambda self, *given: asked.append(given) or real(self, *given))
    # an event with the time of a block's first one may be in the block before
    for window, (first, last) in {(35, 40): (2, 3), (32, 64): (1, 4), (33, 65): (2, 5), (0, 200): (0, 13)}.items():
        start, stop = (int(events.t[at]) if at < 200 else None for at in window)
        assert recording.read(start, stop) == events.window(start, stop)
        assert asked.pop() == (begins[first], begins[last] - begins[first])
        assert not asked


@pytest.mark.parametrize("at_once", [0, 71, 72, 100, 72 + 24 * 13, 72 + 24 * 13 + 50, 1 << 16])
@pytest.mark.parametrize("compress", [False, True])
def test_heads_longer_than_what_is_read_at_once(tmp_path, monkeypatch, at_once, compress):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    recordings = [trees.some(1, 200), trees.some(2, 1), trees.some(3, 100)]
    path = store_of(tmp_path, *recordings, compress=compress)
    monkeypatch.setattr("nvsdata.datasets.store.reader.AT_ONCE", max(at_once, record.HEAD.size))
    store = Store(path)
    for name, events in zip(store.names, recordings, strict=True):
        recording = store.open(name, None)
        assert recording.read() == events
        assert recording.read(int(events.t[0]) + 1) == events.window(int(events.t[0]) + 1)
        assert store.fault(name) == ""


@pytest.mark.parametrize(
    ("size", "width"), [((256, 256), 1), ((257, 1), 2), ((1, 257), 2), ((1280, 720), 2), ((32_767, 32_767), 2)]
)
@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("compress", [False, True])
def test_pixels_take_a_byte_up_to_256(tmp_path, size, width, known, compress):
    events = Events([1, 2], [0, size[0] - 1], [0, size[1] - 1], [0, 1], size)
    path = store_of(tmp_path, events, compress=compress)
    assert widths(path) == (4, width)
    if known:
        pack(EventFolder(tmp_path / "data", sensor_size=size), path, overwrite=True)
        assert widths(path) == (4, width)
        assert EventFolder(path)[0][0] == events


def test_each_recording_has_its_own_widths(tmp_path):
    path = store_of(
        tmp_path,
        Events([1, 2], [0, 9], [0, 9], [0, 1], (10, 10)),
        Events([1, 2 + LONG], [0, 300], [0, 9], [0, 1], (301, 10)),
    )
    assert [widths(path, number) for number in (0, 1)] == [(4, 1), (8, 2)]


def test_what_states_no_time_begins_and_ends_with_its_events(tmp_path):
    trees.put(tmp_path / "data", {"a/1.bin": trees.atis(Events([5, 70], [1, 2], [3, 4], [0, 1], (9, 9)))})
    pack(EventFolder(tmp_path / "data"), tmp_path / "a.nvs")
    head = storefiles.head_at(tmp_path / "a.nvs", 0)[1]
    assert (head["begin"], head["end"]) == (-(2**63), -(2**63))
    recording = EventFolder(tmp_path / "a.nvs").recording(0)
    assert (recording.start, recording.end, recording.span) == (5, 70, (5, 70))
    assert recording.read().stated_end is None
    assert recording.path == f"{tmp_path / 'a.nvs'}:a/1.bin"
    assert recording.format == "atis"


def test_stated_times_are_kept(tmp_path):
    events = Events([50, 70], [1, 2], [3, 4], [0, 1], (9, 9), start=-3, end=1_000)
    path = store_of(tmp_path, events)
    recording = EventFolder(path).recording(0)
    assert (recording.start, recording.end, recording.span) == (-3, 1_000, (50, 70))
    whole, window = recording.read(), recording.read(60, 100)
    assert (whole.start, whole.stated_end, window.start, window.stated_end) == (-3, 1_000, 60, 99)


@pytest.mark.parametrize(("duration", "width"), [(0, 4), (LONG, 4), (LONG + 1, 8)])
@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("first", [0, -(2**40), LATEST - 2**33, -LATEST])
def test_times_take_four_bytes_as_long_as_they_can(tmp_path, duration, width, compress, first):
    events = Events([first, first + duration], [1, 2], [1, 2], [0, 1], (4, 4))
    path = store_of(tmp_path, trees.some(1, 3), events, compress=compress)
    assert widths(path, 1) == (width, 1)
    recording = EventFolder(path).recording(1)
    for start, stop in ((None, first), (first, None), (first + duration, None), (None, first + duration)):
        assert recording.read(start, stop) == events.window(start, stop)
    assert len(recording.read(-(2**63), 2**63 - 1)) == 2


@pytest.mark.parametrize("compress", [False, True])
def test_the_longest_recording(tmp_path, monkeypatch, compress):
    monkeypatch.setattr(record, "MOST_EVENTS", 1)
    events = Events([-LATEST, -1, 0, 0, 1, LATEST], [1] * 6, [1] * 6, [0, 1] * 3, (4, 4))
    path = store_of(tmp_path, events, compress=compress)
    recording = EventFolder(path).recording(0)
    for t in events.t.tolist():
        assert recording.read(t) == events.window(t, None)
        assert recording.read(None, t) == events.window(None, t)


def test_events_that_compress_too_well_are_not_compressed(tmp_path, monkeypatch):
    same = Events([7] * 60_000, [1] * 60_000, [2] * 60_000, [1] * 60_000, (4, 4))
    path = store_of(tmp_path, same, trees.some(1), compress=True)
    assert [storefiles.head_at(path, number)[1]["compressed"] for number in (0, 1)] == [0, 1]


def test_side_files_up_to_16_mib_travel_along(tmp_path, monkeypatch):
    others = {"a/x.HDF5": b"", "old.nvs": b"abc", "empty.csv": b""}
    trees.put(tmp_path / "data", {"list.txt": b"one", "notes.md": b"two"} | others)
    real = Folder.size
    claimed = {"list.txt": 2**24, "notes.md": 2**24 + 1}
    monkeypatch.setattr(Folder, "size", lambda self, name: claimed.get(name) or real(self, name))
    nvsdata.write(trees.some(1), tmp_path / "data/a/1.npy")
    pack(EventFolder(tmp_path / "data"), tmp_path / "a.nvs")
    store = Store(tmp_path / "a.nvs")
    assert store.listing() == {".": ["empty.csv", "list.txt"], "a": ["1.npy", "x.HDF5"]}
    assert (store.data("list.txt"), store.size("list.txt")) == (b"one", 3)
    assert (store.data("empty.csv"), store.size("empty.csv")) == (b"", 0)


@pytest.mark.parametrize("version", [0, 1, 2, 4, 2**32 - 1])
def test_other_versions_are_refused(tmp_path, version):
    path = store_of(tmp_path, trees.some(1))
    raw = path.read_bytes()
    path.write_bytes(raw[:8] + struct.pack("<I", version) + raw[12:])
    with pytest.raises(FormatError, match=rf"a\.nvs: is of version {version}, and this nvsdata reads up to 3"):
        Store(path)


def test_a_place_of_the_index_outside_the_file(tmp_path):
    path = store_of(tmp_path, trees.some(1))
    raw = path.read_bytes()
    for place, length in ((2**64 - 1, 8), (64, 2**64 - 1), (2**63, 2**63), (len(raw), 1), (0, len(raw)), (63, 8)):
        own = struct.pack("<QQI", place, length, 0).ljust(48, b"\0")
        path.write_bytes(raw[:12] + struct.pack("<I", storefiles.check_of(own)) + own + raw[64:])
        with pytest.raises(FormatError, match=r"a\.nvs: is cut short"):
            Store(path)
    # an index of no bytes, with a right checksum
    own = struct.pack("<QQI", len(raw), 0, 0).ljust(48, b"\0")
    path.write_bytes(raw[:12] + struct.pack("<I", storefiles.check_of(own)) + own + raw[64:])
    with pytest.raises(FormatError, match="its index contradicts itself"):
        Store(path)


@pytest.mark.parametrize(
    ("changes", "sound"),
    [
        ({}, True),
        ({"place": lambda a: a[1:]}, False),
        ({"place": lambda a: a[:-1]}, False),
        ({"place": lambda a: a[:0]}, False),
        ({"place": lambda a: a + 8}, False),
        ({"place": lambda a: a - 64}, False),
        ({"place": lambda a: a[[0, 2, 1, 3]]}, False),
        ({"place": lambda a: a[[0, 1, 1, 3]]}, False),
        ({"place": lambda a: a + np.array([0, 1, 0, 0])}, False),
        ({"place": lambda a: a + np.array([0, 0, 0, 8])}, False),
        ({"place": lambda a: a - np.array([0, 0, 0, 8])}, False),
        ({"bytes": lambda a: a[1:]}, False),
        ({"bytes": lambda a: a * 0}, True),
        ({"name": lambda a: a[1:]}, False),
        ({"name": lambda a: [*a, "b"]}, False),
        ({"name": lambda a: [a[0], a[0], a[1]]}, False),
        ({"left_out": lambda a: ["b"]}, False),
        ({"reason": lambda a: ["why"]}, False),
        ({"left_out": lambda a: ["b"], "reason": lambda a: ["why"]}, True),
        ({"file_name": lambda a: [*a, "b"]}, False),
        ({"file_name": lambda a: a[1:]}, False),
        ({"file_end": lambda a: a[1:]}, False),
        ({"file_end": lambda a: a[::-1]}, False),
        ({"file_end": lambda a: a + 1}, False),
        ({"file_end": lambda a: a - 1}, False),
        ({"file_data": lambda a: a[1:]}, False),
        ({"file_data": lambda a: a + b"1"}, False),
        ({"file_name": lambda a: [], "file_end": lambda a: [], "file_data": lambda a: b""}, True),
        ({"file_name": lambda a: [], "file_end": lambda a: []}, False),
    ],
)
def test_which_values_an_index_may_have(tmp_path, changes, sound):
    trees.put(tmp_path / "data", {"list.txt": b"one", "more.txt": b"more words"})
    path = store_of(tmp_path, *(trees.some(seed, 3) for seed in range(3)))
    found = storefiles.index_of(path)
    storefiles.reindex(path, **{name: change(found[name]) for name, change in changes.items()})
    if sound:
        assert len(Store(path).names) == 3
    else:
        with pytest.raises(FormatError, match=r"a\.nvs: its index contradicts itself: pack it again"):
            Store(path)


@pytest.mark.parametrize("name", ["place", "bytes", "file_end"])
@pytest.mark.parametrize("value", [2**63, 2**64 - 1])
def test_numbers_beyond_63_bits(tmp_path, name, value):
    trees.put(tmp_path / "data", {"list.txt": b"one"})
    path = store_of(tmp_path, trees.some(1, 3))
    changed = storefiles.index_of(path)[name].astype("<u8")
    changed[-1] = value
    storefiles.reindex(path, **{name: changed})
    with pytest.raises(FormatError, match=rf"a\.nvs: its index has impossible values of {name}"):
        Store(path)


@pytest.mark.parametrize(
    "facts",
    [
        {},
        {"dataset": "event-folder", "split": "all"},
        {"dataset": "event-folder", "split": "all", "fold": "0"},
        {"dataset": "event-folder", "split": "all", "fold": True},
        {"dataset": "event-folder", "split": None, "fold": 0},
        {"dataset": ["event-folder"], "split": "all", "fold": 0},
        [],
        float("nan"),
    ],
)
def test_facts_of_other_types(tmp_path, facts):
    path = store_of(tmp_path, trees.some(1))
    storefiles.reindex(path, facts=facts)
    with pytest.raises(FormatError, match=r"a\.nvs: its index doesn't state the dataset"):
        Store(path)


def test_facts_do_not_replace_sections(tmp_path):
    path = store_of(tmp_path, trees.some(1))
    found = storefiles.index_of(path)
    storefiles.reindex(path, {name: found[name] for name in ("dataset", "split", "fold")} | {"place": 5, "name": "b"})
    assert Store(path).names == ["a/0.h5"]


def sections_of(path):
    raw = path.read_bytes()
    place, *_ = index.index_place(raw[:64], len(raw))
    sizes = struct.unpack_from("<14Q", raw, place)
    begins = place + 112 + np.cumsum([0, *(size + -size % 8 for size in sizes)])
    return [raw[begin : begin + size] for begin, size in zip(begins, sizes, strict=False)]


def whole(sections):
    return struct.pack("<14Q", *map(len, sections)) + b"".join(part + bytes(-len(part) % 8) for part in sections)


@pytest.mark.parametrize("name", ["facts", "name", "folder", "left_out", "reason", "file_name", "place", "bytes"])
def test_sections_of_random_bytes(tmp_path, name):
    path = store_of(tmp_path, trees.some(1), trees.some(2))
    sections, at = sections_of(path), index.SECTIONS.index(name)
    storefiles.put_index(path, whole(sections))
    assert len(Store(path).names) == 2
    rng = np.random.default_rng(0)
    for size in range(1, 60):
        other = rng.integers(128, 256, size).astype(np.uint8).tobytes()
        storefiles.put_index(path, whole([*sections[:at], other, *sections[at + 1 :]]))
        with pytest.raises(FormatError, match=r"a\.nvs: .*"):
            Store(path)


@pytest.mark.parametrize("raw", [b"", bytes(111), bytes(112), bytes(120), b"\xff" * 112, b"\xff" * 800, b"[" * 100_000])
def test_an_index_of_other_bytes(tmp_path, raw):
    path = store_of(tmp_path, trees.some(1))
    storefiles.put_index(path, raw)
    with pytest.raises(FormatError, match=r"a\.nvs: its index"):
        Store(path)
    deep = [b"[" * 100_000, *sections_of(store_of(tmp_path / "other", trees.some(1)))[1:]]
    storefiles.put_index(path, whole(deep))
    with pytest.raises(FormatError, match="its index doesn't state the dataset"):
        Store(path)


@pytest.mark.parametrize(
    ("fields", "sound"),
    [
        ({}, True),
        ({"width": 32_767, "height": 32_767}, True),
        ({"width": 32_768}, False),
        ({"height": 65_535}, False),
        ({"width": 0}, False),
        ({"height": 0}, False),
        ({"blocks": 0}, False),
        ({"blocks": 3}, False),
        ({"blocks": 5}, False),
        ({"blocks": 2**32 - 1}, False),
        ({"events": 0}, False),
        ({"events": 61}, False),
        ({"events": 2**64 - 1}, False),
        ({"base": LATEST}, False),
        ({"base": LATEST + 1}, False),
        ({"base": -LATEST - 1}, False),
        ({"base": -(2**63)}, False),
        ({"duration": -1}, False),
        ({"duration": 2**63 - 1}, False),
        ({"t_bytes": 5}, False),
        ({"t_bytes": 0}, False),
        ({"xy_bytes": 0}, False),
        ({"xy_bytes": 255}, False),
        ({"compressed": 2}, False),
        ({"guessed": 1}, True),
        ({"guessed": 2}, False),
        ({"begin": 5, "end": -5}, False),
        ({"begin": -(2**63), "end": 5}, False),
        ({"format": b"\xff\0\n" * 5}, True),
    ],
)
@pytest.mark.parametrize("compress", [False, True])
def test_which_values_a_head_may_have(tmp_path, monkeypatch, fields, sound, compress):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    events = trees.some(1)
    path = store_of(tmp_path, events, trees.some(2), compress=compress)
    storefiles.put_head(path, 0, **fields)
    store = Store(path)
    if sound:
        found = store.open("a/0.h5", None).read()
        assert all((ours == other).all() for ours, other in zip(found.columns, events.columns, strict=True))
    else:
        for _ in range(2):
            with pytest.raises(FormatError, match=r"a\.nvs:a/0\.h5: byte 64: .*(contradicts itself|cut short)"):
                store.open("a/0.h5", None)
            assert store.fault("a/0.h5")
    assert store.open("a/1.h5", None).read() == trees.some(2)


def changed(name, place, value):
    def change(table):
        table[name][place] = value

    return change


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        ("first", 0, 1),
        ("first", 0, -1),
        ("first", 1, 2**62),
        ("first", 1, -1),
        ("first", 3, 2**63 - 1),
        ("first", slice(1, 3), [2**63 - 1, -(2**63)]),
        ("events", 1, 0),
        ("events", 1, 15),
        ("events", 1, 17),
        ("events", 1, 2**32 - 1),
        ("events", slice(0, 2), [15, 16]),
        ("events", slice(0, 2), [0, 32]),
        ("bytes", 1, 0),
        ("bytes", 1, 1),
        ("bytes", 1, 2**32 - 1),
        ("bytes", 3, 20),
        ("check", 2, 0),
    ],
)
@pytest.mark.parametrize("compress", [False, True])
def test_which_values_a_table_of_blocks_may_have(tmp_path, monkeypatch, name, place, value, compress):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    path = store_of(tmp_path, trees.some(1), trees.some(2), compress=compress)
    storefiles.put_head(path, 0, changed(name, place, value))
    store = Store(path)
    for _ in range(2):
        assert store.fault("a/0.h5")
        with pytest.raises(FormatError, match=r"a\.nvs:a/0\.h5: byte \d+: "):
            store.open("a/0.h5", None).read()
    assert store.open("a/1.h5", None).read() == trees.some(2)


@pytest.mark.parametrize("fields", [{"t_bytes": 8}, {"xy_bytes": 2}, {"t_bytes": 8, "xy_bytes": 2}])
@pytest.mark.parametrize("compress", [False, True])
def test_blocks_of_other_widths(tmp_path, monkeypatch, fields, compress):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    path = store_of(tmp_path, trees.some(1), compress=compress)
    begin = storefiles.block_places(path, 0)[0]
    storefiles.put_head(path, 0, **fields)
    store = Store(path)
    # the size of compressed blocks doesn't tell
    reason = f"byte {begin}: .*(before or after|another length)" if compress else "byte 64: .*contradicts itself"
    for _ in range(2):
        with pytest.raises(FormatError, match=reason):
            store.open("a/0.h5", None).read()
        assert store.fault("a/0.h5")


@pytest.mark.parametrize("shift", [-1, 1, 100_000])
@pytest.mark.parametrize("compress", [False, True])
def test_a_head_with_a_right_checksum_and_another_duration_is_named(tmp_path, shift, compress):
    path = store_of(tmp_path, trees.some(1), trees.some(2), compress=compress)
    duration = storefiles.head_at(path, 0)[1]["duration"]
    storefiles.put_head(path, 0, duration=duration + shift, begin=-(2**63), end=-(2**63))
    store = Store(path)
    assert "other times" in store.fault("a/0.h5")
    assert store.fault("a/1.h5") == ""
    with pytest.raises(FormatError, match="other times"):
        store.open("a/0.h5", None).read()


def read_or_named(store, window):
    """Events in a window of the first recording, or the reason why there are none."""
    try:
        return store.open("a/0.h5", None).read(*window)
    except FormatError as error:
        return "other times" if "other times" in error.reason else error.reason


@pytest.mark.parametrize("shift", [-1, 1])
def test_a_table_with_a_right_checksum_and_other_times_is_named(tmp_path, monkeypatch, shift):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    events = trees.some(1, gap=3_000)
    path = store_of(tmp_path, events, trees.some(2))

    def moved(table):
        table["first"][2] += shift

    storefiles.put_head(path, 0, moved)
    store = Store(path)
    assert "other times" in store.fault("a/0.h5")
    assert store.fault("a/1.h5") == ""
    border = int(events.t[32])
    # windows without block 2, as the table states it, can't show the difference
    for window in ((border, None), (None, border), (border + 1, None), (None, border + 2), (border - 1, border)):
        assert read_or_named(store, window) in (events.window(*window), "other times")


def stopped(dataset, out, monkeypatch):
    """Names that are decoded until all records are in the part."""
    decode, seen = packing._decode, []

    def stops(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(writing, "_finish", stops)
        patch.setattr(packing, "_decode", lambda *given: seen.append(given[-1]) or decode(*given))
        with pytest.raises(KeyboardInterrupt):
            pack(dataset, out)
    return seen


def test_what_lies_behind_a_change_is_decoded_anew_once(tmp_path, monkeypatch):
    files = {f"a/{number}.bin": trees.atis(trees.some(number)) for number in range(5)} | {"a/5.bin": b"abc"}
    dataset = EventFolder(trees.put(tmp_path / "data", files))
    out = tmp_path / "a.nvs"
    assert stopped(dataset, out, monkeypatch) == list(files)
    # those left out are always tried again
    assert stopped(dataset, out, monkeypatch) == ["a/5.bin"]
    trees.put(tmp_path / "data", {"a/2.bin": trees.atis(trees.some(9, 61))})
    os.utime(tmp_path / "data/a/2.bin", ns=(1, 1))
    assert stopped(dataset, out, monkeypatch) == list(files)[2:]
    assert stopped(dataset, out, monkeypatch) == ["a/5.bin"]
    assert list(pack(dataset, out).skipped) == ["a/5.bin"]
    check_same(EventFolder(out), dataset.subset(range(5)))


def test_a_recording_that_can_not_be_looked_at_is_decoded_anew(tmp_path, monkeypatch):
    files = {f"a/{number}.bin": trees.atis(trees.some(number)) for number in range(3)}
    dataset = EventFolder(trees.put(tmp_path / "data", files))
    stopped(dataset, tmp_path / "a.nvs", monkeypatch)
    stamp, asked = Folder.stamp, []

    def fails_once(self, name):
        asked.append(name)
        if asked == ["a/0.bin", "a/1.bin"]:
            raise OSError("the disk")
        return stamp(self, name)

    monkeypatch.setattr(Folder, "stamp", fails_once)
    assert stopped(dataset, tmp_path / "a.nvs", monkeypatch) == ["a/1.bin", "a/2.bin"]
    pack(dataset, tmp_path / "a.nvs")
    check_same(dataset, EventFolder(tmp_path / "a.nvs"))
