"""Bytes that windows of files take: as many as their events, not as many as the file has."""

import os
from typing import NamedTuple

import numpy as np
import pytest
from counting_work import PROCESS, bytes_read
from storefiles import block_places

import nvsdata
from nvsdata import EventFolder, Events
from nvsdata.datasets.store.index import BEGIN, index_place
from nvsdata.datasets.store.reader import AT_ONCE, Store
from nvsdata.datasets.store.record import MOST_EVENTS
from nvsdata.datasets.store.writer import pack
from nvsdata.formats import index_cache
from nvsdata.formats.contents import PIECE

if not PROCESS.exists():
    pytest.skip("only Linux counts the bytes that a process reads", allow_module_level=True)

N, GAP, SIZE = 100_000, 10, (128, 128)
SHARES = (0.001, 0.01, 0.1, 1)
COMPARED = 2 * 2  # blocks
HEAD = 1 << 16  # bytes by which a file is recognized
LONG = 25 * MOST_EVENTS // 2  # events of a recording in a store


class Kind(NamedTuple):
    """How a format lays out what windows read.

    - `block`: events or words that are read together
    - `most`: of these blocks, those that a window may read beyond its events
    - `more`: other bytes: bisection
    """

    name: str
    block: int
    most: int = 2
    more: int = 0
    format: str | None = None


KINDS = {
    # and two blocks for each end of the window, with which a kept index is compared
    "atis": Kind("a.bin", 256, 2 + COMPARED),
    # only the first records of blocks are known: one more on either side
    "dat": Kind("a.dat", 4096, 4),
    "aedat2": Kind("a.aedat", 4096, 4),
    "aedat1": Kind("a.aedat1", 4096, 4),
    "npy": Kind("a.npy", 4096, 4),
    "aedat3": Kind("a.aedat3", 8192),
    # to see that the window doesn't reach into them
    "aedat4": Kind("a.aedat4", 8192, 4),
    "evt2": Kind("a.raw", 4096, 2 + COMPARED, format="evt2"),
    "evt2.1": Kind("a.raw", 4096, 2 + COMPARED, format="evt2.1"),
    "evt3": Kind("a.raw", 4096, 2 + COMPARED, format="evt3"),
    # times around either end, and pieces of four bytes on the way there
    "hdf5": Kind("a.h5", 2 * 512 + 64, 2, more=8 * 2 * 17),
}
every = pytest.mark.parametrize("kind", KINDS)


def events(n=N):
    rng = np.random.default_rng(0)
    return Events(np.arange(n) * GAP, *(rng.integers(0, side, n) for side in (*SIZE, 2)), SIZE)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A path for each kind and number of events, of a file that was written long ago."""
    made = {}

    def path(kind, n=N):
        if (kind, n) not in made:
            folder, how = tmp_path_factory.mktemp("files"), KINDS[kind]
            nvsdata.write(events(n), folder / how.name, format=how.format)
            os.utime(folder / how.name, ns=(10**18, 10**18))
            # compiled kernels are loaded, and indices kept
            nvsdata.open(folder / how.name, sensor_size=SIZE).read(0, GAP)
            nvsdata.read(folder / how.name, sensor_size=SIZE)
            made[kind, n] = folder / how.name
        return made[kind, n]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(index_cache, "LEAST", 1_000)
        patch.setattr(index_cache, "SETTLED_NS", 0)
        yield path


def taken(recording, start, count):
    """Bytes that a window of `count` events takes, from event number `start` on."""
    with bytes_read() as tally:
        found = recording.read(start * GAP, (start + count) * GAP)
    assert len(found) == count
    return tally["bytes"]


def bound(kind, path, count, n=N):
    """Bytes of that many events, those of the blocks around them, and others."""
    how = KINDS[kind]
    each = path.stat().st_size / n
    # a word is at most an event
    return each * (count + how.most * how.block) + how.more


@every
def test_a_window_takes_the_bytes_of_its_events_and_of_a_few_blocks(files, kind):
    path = files(kind)
    recording = nvsdata.open(path, sensor_size=SIZE)
    recording.read(0, GAP)
    for share in SHARES:
        count = round(share * N)
        for start in {0, (N - count) // 2, N - count}:
            assert taken(recording, start, count) <= bound(kind, path, count)


@pytest.mark.parametrize("kind", ["evt2.1", "evt3"])
def test_a_file_of_several_pieces_is_read_twice_but_for_the_first(files, kind):
    # events are counted first, because vectors hold any number
    path = files(kind, 4 * N)
    size = path.stat().st_size
    assert size > PIECE
    recording = nvsdata.open(path, sensor_size=SIZE)
    recording.read(0, GAP)
    # whole blocks are read, the last of them in part
    assert taken(recording, 0, 4 * N) <= 2 * size - 0.99 * PIECE


@every
def test_a_window_takes_as_much_of_a_longer_file(files, kind):
    paths = files(kind), files(kind, 2 * N)
    once, twice = (nvsdata.open(path, sensor_size=SIZE) for path in paths)
    once.read(0, GAP)
    twice.read(0, GAP)
    for count in (100, 10_000):
        # a kept index is compared with these blocks once
        for recording in (once, twice):
            recording.read(50_000 * GAP, (50_000 + count) * GAP)
        # the same bytes, unless words of time fall otherwise or are compressed otherwise; and another step of bisection
        assert taken(twice, 50_000, count) <= 1.01 * taken(once, 50_000, count) + 64


@every
def test_opening_takes_the_head_only(files, kind):
    for path in (files(kind), files(kind, 2 * N)):
        with bytes_read() as tally:
            nvsdata.open(path, sensor_size=SIZE)
        # HDF5's own library reads where its columns are
        assert tally["bytes"] <= HEAD + (4096 if kind == "hdf5" else 0)


@pytest.mark.parametrize("kind", ["dat", "aedat2", "aedat1", "npy", "aedat3", "aedat4"])
def test_the_first_window_takes_few_bytes_of_each_block(files, kind):
    path, how = files(kind), KINDS[kind]
    recording = nvsdata.open(path, sensor_size=SIZE)
    # of records the first eight, of packets headers and a table
    index = path.stat().st_size / how.block * 16
    assert taken(recording, 0, 100) <= index + bound(kind, path, 100)


@pytest.mark.parametrize("kind", ["atis", "evt2", "evt2.1", "evt3"])
def test_a_kept_index_saves_the_walk_over_the_file(files, kind):
    path = files(kind)
    kept = index_cache.path_of(str(path)).stat().st_size
    recording = nvsdata.open(path, sensor_size=SIZE)
    # numpy reads the ends of its archive again; some entries are compared with two blocks each
    each = path.stat().st_size / N * KINDS[kind].block
    compared = 2 * each * (index_cache.COMPARED + 2)
    assert taken(recording, 0, 100) <= bound(kind, path, 100) + 2 * kept + 4096 + compared


def test_of_packets_only_those_around_the_window_are_inflated(files, monkeypatch):
    recording = nvsdata.open(files("aedat4"))
    recording.read(0, GAP)
    inflated, inflate = [], recording._inflate
    monkeypatch.setattr(recording, "_inflate", lambda *packet: inflated.append(1) or inflate(*packet))
    for count in (10, 20_000, N):
        inflated.clear()
        taken(recording, (N - count) // 2, count)
        assert len(inflated) <= count / 8192 + 4


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "compressed"])
def packed(tmp_path_factory, request):
    """A store of a short recording, one of two blocks, and one of twelve and a half."""
    folder = tmp_path_factory.mktemp("packed")
    (folder / "data/a").mkdir(parents=True)
    for name, n in enumerate((1_000, 2 * MOST_EVENTS, LONG)):
        nvsdata.write(events(n), folder / f"data/a/{name}.h5")
    pack(EventFolder(folder / "data"), folder / "a.h5", compress=request.param)
    return folder / "a.h5"


def test_a_window_of_a_store_takes_the_blocks_that_it_is_in(packed):
    recording = EventFolder(packed).recording(2)
    ends = np.array(block_places(packed, 2))
    for share in SHARES:
        count = round(share * LONG)
        for start in {0, 5 * MOST_EVENTS, (LONG - count) // 2, LONG - count}:
            if start + count > LONG:
                continue
            # the block before too, because equal times could begin there
            first = max((start - 1) // MOST_EVENTS, 0)
            last = -(-(start + count) // MOST_EVENTS)
            assert taken(recording, start, count) == ends[last] - ends[first]


def test_a_window_beside_the_events_takes_a_block_at_most(packed):
    recording = EventFolder(packed).recording(2)
    most = np.diff(block_places(packed, 2)).max()
    for window in ((-1_000, 0), (LONG * GAP, LONG * GAP + 1_000), (500_000 * GAP + 1, 500_000 * GAP + 2)):
        with bytes_read() as tally:
            assert not len(recording.read(*window))
        assert tally["bytes"] <= most


def test_a_store_is_opened_by_its_head_and_index_and_a_recording_by_its_head(packed):
    raw = packed.read_bytes()
    _, length, _ = index_place(raw[:BEGIN], len(raw))
    with bytes_read() as tally:
        store = Store(packed)
    assert tally["bytes"] == BEGIN + length
    for number, name in enumerate(store.names):
        with bytes_read() as tally:
            recording = store.open(name, None)
        room = store._place[number + 1] - store._place[number]
        assert tally["bytes"] == min(room, AT_ONCE)
        # what was read with the head isn't read again
        with bytes_read() as tally:
            recording.read()
        first, *_, last = block_places(packed, number)
        assert tally["bytes"] == (0 if room <= AT_ONCE else last - first)
