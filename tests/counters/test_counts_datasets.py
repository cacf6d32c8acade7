"""What datasets read: names when they are made, and of recordings what a sample needs."""

import os
from collections import Counter

import numpy as np
import pytest
import trees
from counting_work import PROCESS, bytes_read

import nvsdata
from nvsdata import NMNIST, EventFolder, Events
from nvsdata import transforms as T
from nvsdata.datasets import source, windows

if not PROCESS.exists():
    pytest.skip("only Linux counts the bytes that a process reads", allow_module_level=True)

HEAD = 1 << 16
LONG = 200_000


@pytest.fixture
def digits(tmp_path):
    return settled(trees.put(tmp_path / "data", trees.nmnist()))


@pytest.fixture
def long(tmp_path):
    """A folder of one recording of 1.4 MB, an event every 10 µs."""
    rng = np.random.default_rng(0)
    columns = (rng.integers(0, side, LONG) for side in (128, 128, 2))
    (tmp_path / "data/a").mkdir(parents=True)
    nvsdata.write(Events(np.arange(LONG) * 10, *columns, (128, 128)), tmp_path / "data/a/0.h5")
    return settled(tmp_path / "data")


def settled(root):
    """The folder, unchanged for long."""
    for path in (root, *root.rglob("*")):
        os.utime(path, ns=(10**18, 10**18))
    return root


@pytest.fixture
def looks(monkeypatch):
    """Counts folders that are read, and other looks at files."""
    tally = Counter()
    for name in ("scandir", "listdir", "stat"):
        function = getattr(os, name)

        def counting(*args, function=function, name=name, **kwargs):
            tally[name] += 1
            return function(*args, **kwargs)

        monkeypatch.setattr(os, name, counting)
    return tally


def test_a_dataset_is_made_from_names_alone(digits):
    NMNIST(digits)[0]
    with bytes_read() as tally:
        dataset = NMNIST(digits)
        assert len(dataset) == 30
        assert len(dataset.classes) == 10
    assert tally["bytes"] == 0


def test_unchanged_folders_are_not_read_again(digits, looks, monkeypatch):
    monkeypatch.setattr(source, "MANY_FILES", 5)
    NMNIST(digits)
    folders = 1 + 2 + 20
    assert looks["scandir"] >= folders
    looks.clear()
    with bytes_read() as tally:
        NMNIST(digits)
    # but for a few, with which the index is compared
    assert looks["scandir"] == source.COMPARED
    assert looks["listdir"] == 0
    # each once, and the root a few times
    assert folders <= looks["stat"] <= folders + 8
    assert tally["bytes"] <= (digits / source.INDEX).stat().st_size + 1


def test_a_sample_reads_its_own_file_once(digits):
    dataset = NMNIST(digits)
    dataset[0]
    for index in (0, 7):
        (name,) = dataset.files_of([dataset.samples[index]])
        size = os.stat(digits / name).st_size
        with bytes_read() as tally:
            dataset[index]
        assert tally["bytes"] == size


def test_a_cached_sample_decodes_nothing(digits, tmp_path, looks, monkeypatch):
    steps = T.Compose([T.RadiusGraph(4)])
    cached = nvsdata.cache(NMNIST(digits, transform=steps), tmp_path / "cache")
    cached[0], cached[0], cached[1]
    (kept,) = (tmp_path / "cache").rglob("1.pt")
    looks.clear()
    opened, opens = [], source.Folder.open
    monkeypatch.setattr(source.Folder, "open", lambda *args, **more: opened.append(args) or opens(*args, **more))
    with bytes_read() as tally:
        cached[1]
    assert not opened
    # torch looks at the end of the archive first
    assert tally["bytes"] <= 2 * kept.stat().st_size + 4096
    assert looks["scandir"] == looks["listdir"] == 0
    cached[2]
    assert len(opened) == 1


def test_a_pipeline_reads_the_window_that_it_begins_with(long):
    window = T.Window(1_000_000, 1_020_000)
    for transform in (window, T.Compose([window, T.RadiusGraph(3)])):
        dataset = EventFolder(long, transform=transform)
        dataset[0]
        with bytes_read() as tally:
            dataset[0]
        # 2,000 events, of 9 bytes at most
        assert tally["bytes"] <= HEAD + 8192 + 9 * (2_000 + 2_000)


def test_windows_as_samples_read_themselves(long):
    dataset = nvsdata.windows(EventFolder(long), 20_000)
    assert len(dataset) == 100
    dataset[0]
    with bytes_read() as tally:
        assert len(dataset[50][0]) == 2_000
    assert tally["bytes"] <= HEAD + 8192 + 9 * (2_000 + 2_000)


def test_windows_are_cut_anew_from_what_was_noted(long, monkeypatch):
    nvsdata.windows(EventFolder(long), 20_000)
    settled(long)
    (noted,) = long.glob(".nvsdata-windows-*")
    # some recordings are compared with it
    monkeypatch.setattr(windows, "COMPARED", 0)
    nvsdata.windows(EventFolder(long), 20_000)
    with bytes_read() as tally:
        nvsdata.windows(EventFolder(long), 20_000)
    assert tally["bytes"] <= noted.stat().st_size + 1
