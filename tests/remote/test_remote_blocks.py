import errno
import os
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from disks import file_limit, small_disk

from nvsdata.common.locks import locked
from nvsdata.remote import blocks
from nvsdata.remote.blocks import BlockCache, block_cache

KEY = "0" * 32


@pytest.fixture
def cache(tmp_path, small):
    return BlockCache(tmp_path / "cache", 1 << 30)


def content(seed, size=4096):
    return np.random.default_rng(seed).integers(0, 256, size, np.uint8)


def read(block, at=0, size=4096):
    target = np.empty(size, np.uint8)
    return target if block.fill(at, target) else None


@pytest.mark.parametrize("size", [1, 1023, 1024, 1025, 4096])
def test_a_block_is_read_as_it_was_written(cache, size):
    raw = content(0, size)
    for block in (cache.add(KEY, 5, raw), cache.open(KEY, 5, size)):
        for at, end in ((0, size), (size // 3, size // 2), (size - 1, size)):
            assert np.array_equal(read(block, at, end - at), raw[at:end])
    assert cache.open(KEY, 6, size) is None
    assert cache.open("1" * 32, 5, size) is None


def test_a_damaged_piece_is_noticed_and_others_can_be_read(cache):
    cache.add(KEY, 0, content(0))
    path = cache.path(KEY, 0)
    for at in range(0, path.stat().st_size, 37):
        raw = bytearray(path.read_bytes())
        raw[at] ^= 4
        path.write_bytes(raw)
        block = cache.open(KEY, 0, 4096)
        if at >= 4096:
            assert block is None
        else:
            assert read(block, at, 1) is None
            assert read(block) is None
            assert read(block, (at + 1024) % 4096, 1) == content(0)[(at + 1024) % 4096]
        raw[at] ^= 4
        path.write_bytes(raw)
    assert np.array_equal(read(cache.open(KEY, 0, 4096)), content(0))


def test_a_block_under_another_name_or_of_another_length_is_refused(cache):
    cache.add(KEY, 0, content(0))
    for key, number in ((KEY, 1), ("1" * 32, 0)):
        other = cache.path(key, number)
        other.parent.mkdir(exist_ok=True)
        other.write_bytes(cache.path(KEY, 0).read_bytes())
        assert cache.open(key, number, 4096) is None
        assert not other.exists()
    for length, end in ((4095, None), (1024, None), (4096, 2000)):
        cache.add(KEY, 0, content(0))
        if end:
            os.truncate(cache.path(KEY, 0), end)
        assert cache.open(KEY, 0, length) is None
        assert not cache.path(KEY, 0).exists()
    cache.add(KEY, 1, content(0))
    cache.path(KEY, 0).symlink_to(cache.path(KEY, 1))
    assert cache.open(KEY, 0, 4096) is None
    assert not cache.path(KEY, 0).is_symlink()
    assert cache.path(KEY, 1).exists()
    cache.path(KEY, 0).mkdir()
    with pytest.warns(UserWarning, match="can't be written to"):
        assert cache.open(KEY, 0, 4096) is None


def test_a_block_that_is_open_can_be_read_after_the_cache_is_emptied(cache):
    block = cache.add(KEY, 0, content(0))
    cache.path(KEY, 0).unlink()
    assert np.array_equal(read(block), content(0))


def test_only_the_damaged_file_is_removed(cache):
    block = cache.add(KEY, 0, content(0))
    cache.add(KEY, 0, content(1))
    # another process has written it again
    cache.remove(KEY, 0, block)
    assert np.array_equal(read(cache.open(KEY, 0, 4096)), content(1))
    cache.remove(KEY, 0, cache.open(KEY, 0, 4096))
    assert cache.open(KEY, 0, 4096) is None


def test_blocks_used_least_recently_are_removed(tmp_path, small, monkeypatch):
    cache = BlockCache(tmp_path / "cache", 10 * 5000)
    for number in range(10):
        cache.add(KEY, number, content(number))
        os.utime(cache.path(KEY, number), (number, number))
    assert len(list(cache.folder.glob("*/*.block"))) == 10
    assert cache.open(KEY, 0, 4096)
    for number in range(10, 13):
        cache.add(KEY, number, content(number))
    left = {int(path.stem) for path in cache.folder.glob("*/*.block")}
    assert {0, 10, 11, 12} <= left
    assert not {1, 2} & left
    assert sum(path.stat().st_size for path in cache.folder.glob("*/*.block")) <= cache.most


def test_the_size_is_checked_when_a_part_of_it_was_written(tmp_path, small, monkeypatch):
    cache = BlockCache(tmp_path / "cache", 64 * 3 * 4096)
    checks = []
    monkeypatch.setattr(cache, "_trim", lambda: checks.append(number))
    for number in range(9):
        cache.add(KEY, number, content(number))
    assert checks == [0, 4, 8]


def test_a_full_disk_is_reported_once_and_nothing_is_lost(cache):
    cache.add(KEY, 0, content(0))
    with file_limit(1000), pytest.warns(UserWarning, match=r"cache can't be written to.*File too large") as warned:
        found = [read(cache.add(KEY, number, content(number))) for number in range(1, 4)]
    assert len(warned) == 1
    assert all(np.array_equal(one, content(number)) for number, one in enumerate(found, 1))
    assert [path.name for path in cache.folder.glob("*/*")] == ["0.block"]
    assert cache.is_full


def test_a_disk_without_space_leaves_no_unfinished_files(tmp_path, small):
    with small_disk(tmp_path / "disk") as resize:
        resize(1 << 16)
        cache = BlockCache(tmp_path / "disk", 1 << 30)
        with pytest.warns(UserWarning, match="No space left on device"):
            found = [read(cache.add(KEY, number, content(number))) for number in range(30)]
        assert all(np.array_equal(one, content(number)) for number, one in enumerate(found))
        there = list(cache.folder.glob("*/*"))
        assert len(there) > 5
        assert all(np.array_equal(read(cache.open(KEY, int(p.stem), 4096)), content(int(p.stem))) for p in there)


def test_a_folder_that_cannot_be_made_is_reported(tmp_path, small):
    (tmp_path / "file").write_bytes(b"")
    cache = BlockCache(tmp_path / "file/cache", 1 << 30)
    with pytest.warns(UserWarning, match="can't be written to"):
        assert np.array_equal(read(cache.add(KEY, 0, content(0))), content(0))


def test_the_cache_may_be_emptied_at_any_time(cache):
    """Another process removes everything again and again; every block is returned, and no warning given."""
    ended = threading.Event()

    def empty():
        while not ended.is_set():
            for path in sorted(cache.folder.rglob("*"), reverse=True):
                try:
                    path.rmdir() if path.is_dir() else path.unlink()
                except OSError:
                    continue

    thread = threading.Thread(target=empty)
    thread.start()
    try:
        for number in range(150):
            with cache.claimed(KEY, range(number, number + 2), 0):
                assert np.array_equal(read(cache.add(KEY, number, content(number))), content(number))
    finally:
        ended.set()
        thread.join()
    assert not cache.is_full


def test_claims_are_of_neighbors_that_are_missing(cache):
    with cache.claimed(KEY, range(0, 3), 0) as mine:
        assert mine == [0, 1, 2]
    cache.add(KEY, 2, content(2))
    with cache.claimed(KEY, range(0, 4), 0) as mine:
        assert mine == [0, 1]
        with cache.claimed(KEY, range(1, 4), 0) as others:
            assert others == []
    with cache.claimed(KEY, range(2, 4), 0) as mine:
        assert mine == []
    assert [path.name for path in cache.folder.glob("*/*")] == ["2.block"]


def test_a_claim_waits_for_another_process_a_moment_only(cache, monkeypatch):
    waits = []
    monkeypatch.setattr(blocks, "time", SimpleNamespace(sleep=waits.append, monotonic=time.monotonic))
    cache.make_folder(cache.folder / KEY)
    with locked(cache.path(KEY, 0)):
        for until, expected in ((time.monotonic() + 60, [blocks.WAIT]), (0, [blocks.WAIT])):
            with cache.claimed(KEY, range(0, 2), until) as mine:
                assert mine == []
            assert waits == expected


def test_the_place_and_size_come_from_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("NVSDATA_BLOCKS", "~/somewhere")
    monkeypatch.setenv("NVSDATA_BLOCKS_GB", "2.5")
    cache = block_cache()
    assert (cache.folder, cache.most) == (Path.home() / "somewhere", 2_500_000_000)
    monkeypatch.delenv("NVSDATA_BLOCKS")
    monkeypatch.delenv("NVSDATA_BLOCKS_GB")
    cache = block_cache()
    assert (cache.folder.name, cache.folder.parent.name, cache.most) == ("blocks", "nvsdata", 10_000_000_000)
    for wrong in ("0", "-1", "ten", "nan", "inf"):
        monkeypatch.setenv("NVSDATA_BLOCKS_GB", wrong)
        with pytest.raises(ValueError, match="NVSDATA_BLOCKS_GB must be a positive number of GB"):
            block_cache()


def test_errors_of_the_disk_keep_their_number(cache, monkeypatch):
    def fail(*_, **__):
        raise PermissionError(errno.EACCES, "Permission denied", "somewhere")

    monkeypatch.setattr(blocks, "atomic", fail)
    with pytest.warns(UserWarning, match="somewhere: Permission denied"):
        cache.add(KEY, 0, content(0))
