"""What `nvsdata cache` knows of: all that nvsdata writes unasked, and nothing else."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
import trees
from processes_of_others import dead_owner

import nvsdata
from nvsdata import NMNIST, EventFolder
from nvsdata.cli import main
from nvsdata.common.locks import lock_path, locked
from nvsdata.datasets import source
from nvsdata.datasets.archives.download import WORK
from nvsdata.datasets.cache.cleanup import kept_below, remove_kept
from nvsdata.datasets.store import writing
from nvsdata.datasets.windows import windows
from nvsdata.formats import index_cache
from nvsdata.remote.blocks import BlockCache


def kinds(folder):
    return sorted((one.kind, one.path.relative_to(folder).as_posix()) for one in kept_below(folder))


@pytest.fixture
def stopped(tmp_path, monkeypatch):
    """A folder with a packing that ended in the middle."""
    root = trees.put(tmp_path / "digits", trees.nmnist())

    def stops(*given):
        for number, found in enumerate(in_order(*given)):
            if number == 5:
                raise KeyboardInterrupt
            yield found

    in_order = writing.in_order
    with monkeypatch.context() as patch:
        patch.setattr(writing, "in_order", stops)
        with pytest.raises(KeyboardInterrupt):
            nvsdata.pack(NMNIST(root, "all"), tmp_path / "digits.h5")
    return tmp_path


def test_an_unfinished_store_is_known_unless_it_is_being_written(stopped, capsys):
    assert kinds(stopped) == [("unfinished", ".digits.h5.part")]
    with locked(stopped / "digits.h5"):
        assert kinds(stopped) == []
    # something of the user's in there: it stays
    (stopped / ".digits.h5.part/mine.txt").write_text("mine")
    assert kinds(stopped) == []
    (stopped / ".digits.h5.part/mine.txt").unlink()
    # killed while the folder was made, or removed
    (stopped / ".digits.h5.part/data").unlink()
    assert kinds(stopped) == [("unfinished", ".digits.h5.part")]
    assert main(["cache", "clear", str(stopped)]) == 0
    assert "removed: 0." in capsys.readouterr().out
    assert sorted(path.name for path in stopped.iterdir()) == ["digits"]


def test_locks_of_dead_processes_and_unfinished_downloads(tmp_path):
    for name in ("a.h5", "folder"):
        (tmp_path / "folder").mkdir(exist_ok=True)
        entry = {"owner": dead_owner(), "host": "here", "pid": 1, "command": "pack", "since": "then"}
        lock_path(tmp_path / name).write_text(json.dumps(entry))
    (tmp_path / ".mine.lock").write_text("of another program")
    # killed before it signed
    (tmp_path / "unsigned").mkdir()
    lock_path(tmp_path / "unsigned").touch()
    (tmp_path / WORK).mkdir()
    (tmp_path / WORK / "Train.zip.part").write_bytes(b"half")
    expected = [("leftover", ".a.h5.lock"), ("leftover", "folder/.nvsdata.lock")]
    expected += [("leftover", "unsigned/.nvsdata.lock"), ("unfinished", WORK)]
    with locked(tmp_path / "alive.h5"):
        assert kinds(tmp_path) == expected
        for one in list(kept_below(tmp_path)):
            remove_kept(one)
        assert sorted(path.name for path in tmp_path.iterdir()) == [
            ".alive.h5.lock",
            ".mine.lock",
            "folder",
            "unsigned",
        ]


def test_indexes_of_recordings_datasets_and_windows(tmp_path, monkeypatch):
    monkeypatch.setattr(index_cache, "LEAST", 1_000)
    monkeypatch.setattr(index_cache, "SETTLED_NS", 0)
    monkeypatch.setattr(source, "MANY_FILES", 1)
    (tmp_path / "a").mkdir()
    random = np.random.default_rng(0)
    ev = nvsdata.Events(np.arange(20_000) * 10, *random.integers(0, 100, (2, 20_000)), random.integers(0, 2, 20_000))
    nvsdata.write(ev, tmp_path / "a/0.raw", format="evt3")
    os.utime(tmp_path / "a/0.raw", ns=(10**18, 10**18))
    windows(EventFolder(tmp_path), 50_000)
    nvsdata.read(tmp_path / "a/0.raw", 0, 100)
    # of the user's, or somebody else's
    (tmp_path / "a/notes.nvsdata-index").write_text("no hidden file")
    (tmp_path / "a/.link.nvsdata-index").symlink_to(tmp_path / "a/0.raw")
    found = kinds(tmp_path)
    assert [kind for kind, _ in found] == ["index"] * 3
    assert [name for _, name in found][2] == "a/.0.raw.nvsdata-index"
    assert main(["cache", "clear", str(tmp_path)]) == 0
    left = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*"))
    assert left == ["a", "a/.link.nvsdata-index", "a/0.raw", "a/notes.nvsdata-index"]


def test_a_clearing_of_samples_that_was_killed_can_be_continued(tmp_path):
    root = trees.put(tmp_path / "digits", trees.nmnist())
    for path in root.rglob("*.bin"):
        os.utime(path, (1, 1))
    cached = nvsdata.cache(NMNIST(root, "all"), tmp_path / "cache")
    for index in range(3):
        cached[index]
    (kept,) = [one for one in kept_below(tmp_path) if one.kind == "samples"]
    for count in range(1, len(kept.files)):
        kept.files[count - 1].unlink()
        (left,) = [one for one in kept_below(tmp_path) if one.kind == "samples"]
        assert sorted(left.files) == sorted(kept.files[count:])


def test_what_a_process_takes_over_in_the_meantime_stays(stopped):
    lock = lock_path(stopped / "a.h5")
    lock.write_text(json.dumps({"owner": dead_owner(), "host": "here", "pid": 1, "command": "pack", "since": "then"}))
    found = list(kept_below(stopped))
    assert sorted(one.kind for one in found) == ["leftover", "unfinished"]
    with locked(stopped / "a.h5"), locked(stopped / "digits.h5"):
        for one in found:
            remove_kept(one)
        assert lock.exists()
        assert len(list((stopped / ".digits.h5.part").iterdir())) == 2


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes as POSIX has them")
def test_pipes_and_links_in_the_place_of_locks_and_tags(tmp_path):
    (tmp_path / WORK).mkdir()
    (tmp_path / WORK / "Train.zip.part").write_bytes(b"half")
    os.mkfifo(tmp_path / ".nvsdata.lock")
    (tmp_path / "cache").mkdir()
    os.mkfifo(tmp_path / "cache" / "CACHEDIR.TAG")
    (tmp_path / ".a.h5.lock").symlink_to(tmp_path / ".nvsdata.lock")
    assert kinds(tmp_path) == [("unfinished", WORK)]


def test_blocks_of_remote_files_are_a_cache(tmp_path):
    blocks = BlockCache(tmp_path / "a", 1 << 30)
    for number in (0, 1):
        blocks.add("0" * 32, number, np.zeros(100, np.uint8))
    (tmp_path / "a/mine.txt").write_text("mine")
    (found,) = kept_below(tmp_path)
    assert (found.kind, found.path, len(found.files)) == ("blocks", tmp_path / "a", 3)
    assert found.bytes > 200
    remove_kept(found)
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["mine.txt"]
    assert not list(kept_below(tmp_path))
