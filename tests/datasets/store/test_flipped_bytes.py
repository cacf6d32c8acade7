"""Bytes of a store that have changed since it was packed: an error or the same events at every read, never others."""

from __future__ import annotations

import numpy as np
import pytest
import storefiles
import trees

import nvsdata
from nvsdata import NMNIST, EventFolder, Events, FormatError
from nvsdata.datasets.store import record
from nvsdata.datasets.store.opening import open_store
from nvsdata.datasets.store.reader import Store


@pytest.fixture
def store(home, tmp_path):
    nvsdata.pack(NMNIST(home(trees.nmnist()), "all"), tmp_path / "digits.nvs")
    return tmp_path / "digits.nvs"


@pytest.fixture(params=[False, True])
def small(request, tmp_path, monkeypatch):
    """A store of two recordings, one of four blocks with times and coordinates of more bytes, and a side file."""
    monkeypatch.setattr(record, "MOST_EVENTS", 8)
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.integers(0, 2**30, 27))
    wide = Events(t, rng.integers(0, 300, 27), rng.integers(0, 200, 27), rng.integers(0, 2, 27), (300, 200))
    trees.put(tmp_path / "data", {"a/0.bin": trees.atis(trees.some(1, 16)), "list.txt": b"some words"})
    nvsdata.write(wide, tmp_path / "data/a/1.h5")
    nvsdata.pack(EventFolder(tmp_path / "data"), tmp_path / "small.nvs", compress=request.param)
    return tmp_path / "small.nvs"


def flipped(path, at, bit=0):
    raw = bytearray(path.read_bytes())
    raw[at] ^= 1 << bit
    other = path.with_name("flipped.nvs")
    other.write_bytes(raw)
    return other


def first_byte(path, number):
    """The first byte of a recording's blocks."""
    return storefiles.block_places(path, number)[0]


def parts_of(path):
    """Name the part of a store that each byte belongs to, and the byte that an error states (None: it states none)."""
    parts = [("head", None)] * 64
    found = storefiles.index_of(path)
    for number in range(len(found["name"])):
        place, _, table = storefiles.head_at(path, number)
        parts += [("record", place)] * (record.HEAD.size + table.nbytes)
        for begin, end in zip(*(storefiles.block_places(path, number)[part] for part in np.s_[:-1, 1:]), strict=True):
            parts += [(f"block of {number}", begin)] * (end - begin)
        parts += [("padding", None)] * (int(found["place"][number + 1]) - len(parts))
    return parts + [("index", None)] * (path.stat().st_size - len(parts))


def windows_of(events):
    """Windows that need all blocks, one, and some."""
    t = events.t.tolist()
    return (None, None), (t[3], t[4] + 1), (t[10], None)


def reads(store, name, expected):
    """Outcome of each read of a recording: True for the same events, otherwise the error; other events fail."""
    outcomes = []
    for window in windows_of(expected):
        try:
            found = store.open(name, None).read(*window)
        except FormatError as error:
            outcomes.append(error)
        else:
            assert found == expected.window(*window)
            assert (found.start, found.sensor_size) == (expected.window(*window).start, expected.sensor_size)
            outcomes.append(True)
    return outcomes


def all_of(store):
    return {name: store.open(name, None).read() for name in store.names}


def test_every_flipped_byte_of_a_store_that_is_opened_then(small):
    parts, intact = parts_of(small), Store(small)
    expected = all_of(intact)
    listing = intact.listing()
    for at, (part, byte) in enumerate(parts):
        path = flipped(small, at, at % 8)
        if part in ("head", "index"):
            with pytest.raises(FormatError, match=r"flipped\.nvs: "):
                open_store(path)
            continue
        store = open_store(path)
        assert (store.listing(), store.data("list.txt")) == (listing, b"some words")
        found = {name: reads(store, name, expected[name]) for name in store.names}
        errors = {name: [one for one in outcomes if one is not True] for name, outcomes in found.items()}
        damaged = [name for name in store.names if errors[name]]
        faults = {name: fault for name in store.names if (fault := store.fault(name))}
        if part == "padding":
            # reading skips these bytes, but copies are to be the same
            assert (damaged, *faults.values()) == ([], "the bytes that fill its record up aren't zero")
        else:
            (name,) = damaged
            assert list(faults) == damaged
            assert {(str(error.path), error.offset) for error in errors[name]} == {(f"{path}:{name}", byte)}
            # a damaged head makes all reads fail, a damaged block those that need it, and one of all blocks
            assert len(errors[name]) == 3 if part == "record" else found[name][0] is not True
            assert store.fault(name) == errors[name][0].reason


def test_every_flipped_byte_of_a_store_that_is_open_and_was_read(small):
    raw, parts = small.read_bytes(), parts_of(small)
    store = Store(small)
    expected = all_of(store)
    held = [store.open(name, None) for name in store.names]
    with small.open("r+b", buffering=0) as file:
        for at, (part, byte) in enumerate(parts):
            file.seek(at)
            file.write(bytes([raw[at] ^ 1 << at % 8]))
            found = {name: reads(store, name, expected[name]) for name in store.names}
            wrong = {(name, one.offset) for name, outcomes in found.items() for one in outcomes if one is not True}
            assert len(wrong) == (part == "record" or part.startswith("block"))
            assert {offset for _, offset in wrong} <= {byte}
            # heads and small recordings are in memory
            assert [recording.read() for recording in held] == list(expected.values())
            file.seek(at)
            file.write(raw[at : at + 1])
    assert small.read_bytes() == raw
    assert all_of(store) == expected


@pytest.mark.parametrize("compress", [False, True])
def test_every_flipped_byte_of_a_recording_that_is_open_and_larger_than_what_is_read_at_once(
    tmp_path, monkeypatch, compress
):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    monkeypatch.setattr("nvsdata.datasets.store.reader.AT_ONCE", 72)
    events = trees.some(1)
    trees.put(tmp_path / "data", {"a/0.bin": trees.atis(events)})
    nvsdata.pack(EventFolder(tmp_path / "data"), tmp_path / "a.nvs", compress=compress)
    raw, begins = (tmp_path / "a.nvs").read_bytes(), storefiles.block_places(tmp_path / "a.nvs", 0)
    recording = Store(tmp_path / "a.nvs").open("a/0.bin", None)
    t = events.t.tolist()
    # window and its blocks; an event with the time of a block's first one may be in the block before
    windows = {(None, None): range(4), (t[17], t[20]): range(1, 2), (t[33], None): range(2, 4), (None, t[3]): range(1)}
    with (tmp_path / "a.nvs").open("r+b", buffering=0) as file:
        for at in range(begins[0], begins[-1]):
            file.seek(at)
            file.write(bytes([raw[at] ^ 1 << at % 8]))
            block = int(np.searchsorted(begins, at, "right")) - 1
            for window, blocks in windows.items():
                if block in blocks:
                    with pytest.raises(FormatError, match=rf"a\.nvs:a/0\.bin: byte {begins[block]}: .* checksum"):
                        recording.read(*window)
                else:
                    assert recording.read(*window) == events.window(*window)
            file.seek(at)
            file.write(raw[at : at + 1])


def test_random_flips_in_a_data_set_give_an_error_or_the_same_samples(store):
    expected = list(NMNIST(store, "all"))
    random = np.random.default_rng(0)
    found = {"the same": 0, "an error": 0}
    for at in random.choice(store.stat().st_size, 200, replace=False).tolist():
        try:
            samples = list(NMNIST(flipped(store, at, int(random.integers(8))), "all"))
        except FormatError as error:
            found["an error"] += "flipped.nvs" in str(error)
        else:
            assert samples == expected
            found["the same"] += 1
    assert sum(found.values()) == 200
    # all but padding
    assert found["an error"] > 180


@pytest.mark.parametrize("window", [(None, None), (0, 10**5)])
def test_an_error_names_store_recording_and_byte(store, window):
    begin = first_byte(store, 3)
    dataset = NMNIST(flipped(store, begin + 5), "all")
    name = dataset.source.names[3]
    recording = dataset.open_recording(name)
    for _ in range(3):
        with pytest.raises(FormatError, match=rf"flipped\.nvs:{name}: byte {begin}: .* checksum"):
            recording.read(*window)
    # and no other recording
    assert len(dataset.open_recording(dataset.source.names[4]).read())


@pytest.mark.parametrize("compress", [False, True])
def test_the_first_damaged_block_is_named(tmp_path, monkeypatch, compress):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    trees.put(tmp_path / "data", {"a/0.bin": trees.atis(trees.some(1))})
    nvsdata.pack(EventFolder(tmp_path / "data"), tmp_path / "a.nvs", compress=compress)
    begins = storefiles.block_places(tmp_path / "a.nvs", 0)
    path = flipped(flipped(tmp_path / "a.nvs", begins[3]), begins[1] + 3)
    recording = Store(path).open("a/0.bin", None)
    t = trees.some(1).t.tolist()
    for window, block in {(None, None): 1, (t[20], None): 1, (t[35], None): 3, (t[20], t[50]): 1}.items():
        with pytest.raises(FormatError, match=rf"byte {begins[block]}: "):
            recording.read(*window)


def other_events(raw, column, value):
    """Bytes of a block with another value for the last event's x (1), y (2) or p (3), or the first event's t (0)."""
    count = len(raw) // 7
    if column == 0:
        raw[:4] = value.to_bytes(4, "little")
    else:
        raw[(4 + column) * count - 1] = value
    return raw


@pytest.mark.parametrize(
    ("column", "value", "reason"),
    [
        (0, 2**32 - 1, "other times"),
        (1, 34, "outside the sensor"),
        (2, 255, "outside the sensor"),
        (3, 2, "polarities other than 0 and 1"),
    ],
)
@pytest.mark.parametrize("block", [0, 1, 3])
def test_impossible_events_with_right_checksums(tmp_path, monkeypatch, column, value, reason, block):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    events = trees.some(1)
    trees.put(tmp_path / "data", {"a/0.bin": trees.atis(events)})
    nvsdata.pack(EventFolder(tmp_path / "data"), tmp_path / "a.nvs")
    storefiles.put_block(tmp_path / "a.nvs", 0, block, lambda raw: other_events(raw, column, value))
    begin = storefiles.block_places(tmp_path / "a.nvs", 0)[block]
    store = Store(tmp_path / "a.nvs")
    for _ in range(2):
        with pytest.raises(FormatError, match=rf"a\.nvs:a/0\.bin: byte {begin}: .*{reason}"):
            store.open("a/0.bin", None).read()
        assert reason in store.fault("a/0.bin")
    # a window of other blocks
    other = (int(events.t[35]), int(events.t[40])) if block != 2 else (int(events.t[2]), int(events.t[9]))
    assert store.open("a/0.bin", None).read(*other) == events.window(*other)


def deflated(size, given):
    """Compressed bytes of a block's size, with others behind them."""
    packed = record.isal_zlib.compress(given, 1)
    return packed + bytes(size - len(packed))


@pytest.mark.parametrize("count", [0, 1, 97, 99, 10_000])
def test_compressed_blocks_of_more_or_fewer_events_with_right_checksums(tmp_path, monkeypatch, count):
    monkeypatch.setattr(record, "MOST_EVENTS", 16)
    trees.put(tmp_path / "data", {"a/0.bin": trees.atis(trees.some(1))})
    nvsdata.pack(EventFolder(tmp_path / "data"), tmp_path / "a.nvs", compress=True)
    # a block of 16 events has 4 * 16 + 2 * 16 + 2 bytes
    storefiles.put_block(tmp_path / "a.nvs", 0, 1, lambda raw: deflated(len(raw), bytes(count)))
    begin = storefiles.block_places(tmp_path / "a.nvs", 0)[1]
    store = Store(tmp_path / "a.nvs")
    for _ in range(2):
        with pytest.raises(FormatError, match=rf"byte {begin}: its events can't be decompressed: .*before or after"):
            store.open("a/0.bin", None).read()
    assert "before or after" in store.fault("a/0.bin")


@pytest.mark.parametrize("change", [lambda raw: raw[::-1], lambda raw: bytes(len(raw)), lambda raw: b"x" * len(raw)])
def test_compressed_blocks_that_are_none_with_right_checksums(tmp_path, change):
    trees.put(tmp_path / "data", {"a/0.bin": trees.atis(trees.some(1))})
    nvsdata.pack(EventFolder(tmp_path / "data"), tmp_path / "a.nvs", compress=True)
    storefiles.put_block(tmp_path / "a.nvs", 0, 0, change)
    store = Store(tmp_path / "a.nvs")
    with pytest.raises(FormatError, match=r"a\.nvs:a/0\.bin: byte \d+: its events can't be decompressed"):
        store.open("a/0.bin", None).read()


def test_a_head_with_a_right_checksum_that_states_a_smaller_sensor(store):
    for number in range(50):
        storefiles.put_head(store, number, width=5, height=5)
    opened = Store(store)
    recording = opened.open(opened.names[0], None)
    for window in ((), (0, 10**5)):
        with pytest.raises(FormatError, match="outside the sensor"):
            recording.read(*window)
    # reading must not make it trusted
    assert "outside the sensor" in opened.fault(opened.names[0])
    with pytest.raises(FormatError, match="outside the sensor"):
        opened.open(opened.names[0], None).read()


def test_another_sensor_than_the_packed_one(store):
    opened = Store(store)
    assert opened.open(opened.names[0], (40, 34)).read().sensor_size == (40, 34)
    for size in ((34, 5), (5, 34), (5, 100)):
        recording = opened.open(opened.names[0], size)
        for window in ((), (0, 10**6)):
            with pytest.raises(FormatError, match=rf"digits\.nvs:.*outside the sensor of {size[0]}x{size[1]}"):
                recording.read(*window)
    # a window without events is on any sensor
    assert len(opened.open(opened.names[0], (1, 1)).read(-10, -5)) == 0
