"""Sensors of 346x260 and 1280x720 through the packed store and the cache."""

import os

import pytest
import torch
from graphs import same
from storefiles import head_at
from wide import LARGE, corners

import nvsdata
from nvsdata import EventFolder, Events, Graph
from nvsdata import transforms as T
from nvsdata.datasets.store.writer import pack

SIZES = ((34, 34), *LARGE)  # beside each other in one folder


@pytest.fixture
def folder(tmp_path):
    """A recording of each sensor, long unchanged, by class: a large one is neither first nor last in its files."""
    for number, size in enumerate(SIZES):
        ev = corners(size)
        for suffix in (".h5", ".dat"):
            path = tmp_path / "events" / "{}x{}".format(*size) / f"{number}{suffix}"
            path.parent.mkdir(parents=True, exist_ok=True)
            nvsdata.write(ev, path)
            os.utime(path, ns=(10**18, 10**18))
    return tmp_path / "events"


@pytest.mark.parametrize("compress", [False, True])
def test_a_store_keeps_every_pixel(folder, tmp_path, compress):
    report = pack(EventFolder(folder, "all"), tmp_path / "a.h5", compress=compress)
    assert (report.packed, report.skipped) == (6, {})
    read = EventFolder(tmp_path / "a.h5", "all")
    found, most = set(), [0, 0]
    for i in range(6):
        size = tuple(map(int, read.classes[read.targets[i]].split("x")))
        ev, recording = corners(size), read.recording(i)
        assert recording.sensor_size == size
        assert recording.read() == ev
        assert recording.read(3_001, 7_000) == ev.window(3_001, 7_000)
        assert [column.dtype for column in recording.read().columns] == [column.dtype for column in ev.columns]
        found.add(size)
        most = [max(most[0], int(recording.read().x.max())), max(most[1], int(recording.read().y.max()))]
        assert head_at(tmp_path / "a.h5", i)[1]["xy_bytes"] == (1 if max(size) <= 256 else 2)
    assert found == set(SIZES)
    assert most == [1279, 719]


@pytest.mark.parametrize("size", [(256, 256), (257, 40), (40, 257), *LARGE])
@pytest.mark.parametrize("stated", [False, True])
def test_a_store_of_one_sensor_has_as_many_bits_as_it_needs(tmp_path, size, stated):
    ev = corners(size)
    (tmp_path / "events" / "a").mkdir(parents=True)
    nvsdata.write(ev, tmp_path / "events" / "a" / "0.h5")
    pack(EventFolder(tmp_path / "events", "all", sensor_size=size if stated else None), tmp_path / "a.h5")
    assert EventFolder(tmp_path / "a.h5", "all").recording(0).read() == ev
    _, head, table = head_at(tmp_path / "a.h5", 0)
    assert (head["width"], head["height"]) == size
    assert head["xy_bytes"] == (1 if max(size) == 256 else 2)
    assert table["bytes"].sum() == len(ev) * (4 + 2 * head["xy_bytes"] + 1)


HEADS = [
    T.Window(0, 6_000),
    T.Compose([T.Window(0, 6_000), T.RadiusGraph()]),
    T.Compose([T.Window(0, 6_000), T.EventImage()]),
    T.Compose([T.MergePixels(), T.KNNGraph()]),
]


@pytest.mark.parametrize("head", HEADS, ids=repr)
@pytest.mark.parametrize("store", [False, True])
def test_a_cache_gives_what_was_put_in(folder, tmp_path, monkeypatch, head, store):
    root = folder
    if store:
        root = tmp_path / "a.h5"
        pack(EventFolder(folder, "all"), root)
    plain = EventFolder(root, "all", transform=head)
    cached = nvsdata.cache(EventFolder(root, "all", transform=head), tmp_path / "cache")
    made = [cached[i] for i in range(6)]
    monkeypatch.setattr(EventFolder, "recording", lambda *_: pytest.fail("read again"))
    again = [cached[i] for i in range(6)]
    monkeypatch.undo()
    for i, both in enumerate(zip(made, again, strict=True)):
        wanted, target = plain[i]
        for sample, label in both:
            assert label == target
            if isinstance(wanted, Graph):
                assert same(sample, wanted)
                assert sample.pos.max() == max(wanted.sensor_size) - 1
            elif isinstance(wanted, Events):
                assert sample == wanted
                assert sample.sensor_size == wanted.sensor_size
            else:
                assert torch.equal(sample, wanted)
