import multiprocessing
import os
import shutil
import threading

import numpy as np
import pytest
from remote_server import serving, some_faults

from nvsdata.remote import file, transport
from nvsdata.remote.file import RemoteFile
from nvsdata.remote.url import Url

SIZE = 100_000  # 25 small blocks, the last one incomplete


@pytest.fixture
def raw():
    return np.random.default_rng(0).integers(0, 256, SIZE, np.uint8)


@pytest.fixture
def server(tmp_path, raw, small):
    (tmp_path / "files").mkdir()
    (tmp_path / "files/a.bin").write_bytes(raw.tobytes())
    with serving(tmp_path / "files") as server:
        yield server


def opened(server, identity=b""):
    return RemoteFile(Url(f"{server.url}/a.bin"), SIZE, identity)


def read(remote, place, size):
    target = np.empty(size, np.uint8)
    remote.fill(place, target)
    return target


def forget():
    """As in a new process."""
    file._process = None


@pytest.fixture
def no_reading_ahead(monkeypatch):
    monkeypatch.setattr(file, "AHEAD", 0)


def test_any_part_of_a_file_is_read_with_faults_too(server, raw, monkeypatch):
    monkeypatch.setattr(transport, "SILENCE", 0.1)
    server.faults, server.late = some_faults(0.4, ("drop", "cut", "busy", "page", "delay")), 0.3
    remote, rng = opened(server), np.random.default_rng(1)
    for _ in range(100):
        begin, end = np.sort(rng.integers(0, SIZE + 1, 2))
        assert np.array_equal(read(remote, begin, end - begin), raw[begin:end])
    assert read(remote, SIZE, 0).size == 0
    assert sum(server.done[fault] for fault in ("drop", "cut", "busy", "page", "delay")) > 5


def test_each_block_is_requested_once_and_kept_for_other_processes(server, raw, no_reading_ahead):
    remote = opened(server)
    for begin in range(0, SIZE, 1000):
        assert np.array_equal(read(remote, begin, 1000), raw[begin : begin + 1000])
    assert server.done == {"requests": 25, "bytes": SIZE}
    forget()
    read(opened(server), 0, SIZE)
    assert server.done["requests"] == 25


def test_neighbors_are_requested_together(server, raw, no_reading_ahead):
    remote = opened(server)
    assert np.array_equal(read(remote, 5000, 20_000), raw[5000:25_000])
    # blocks 1 to 6
    assert server.done == {"requests": 3, "bytes": 6 * 4096}
    read(remote, 0, SIZE)
    assert server.done["bytes"] == SIZE


def test_the_next_blocks_are_read_ahead_in_order_only(server, raw):
    remote = opened(server)
    for number in (12, 4):
        read(remote, number * 4096, 10)
    assert remote._ahead is None
    read(remote, 5 * 4096, 10)
    remote._ahead.join()
    # two blocks in each request
    assert server.done == {"requests": 5, "bytes": 7 * 4096}
    server.faults = lambda number: "404"
    assert np.array_equal(read(remote, 5 * 4096, 5 * 4096), raw[5 * 4096 : 10 * 4096])


def test_an_error_while_reading_ahead_is_reported_when_the_block_is_needed(server):
    remote = opened(server)
    read(remote, 0, 10)
    server.faults = lambda number: "403" if number >= 2 else None
    read(remote, 5000, 10)
    remote._ahead.join()
    with pytest.raises(PermissionError):
        read(remote, 9000, 10)


def test_files_of_other_identity_size_or_url_have_other_blocks(server, raw):
    read(opened(server), 0, 10)
    read(opened(server), 0, 10)
    assert server.done["requests"] == 1
    (server.root / "a.bin").write_bytes(raw[::-1].tobytes())
    assert np.array_equal(read(opened(server, b"other"), 0, 10), raw[::-1][:10])
    assert np.array_equal(read(RemoteFile(Url(f"{server.url}/a.bin"), SIZE - 1, b""), 0, 10), raw[::-1][:10])
    assert np.array_equal(read(RemoteFile(Url(f"{server.url}/./a.bin"), SIZE, b""), 0, 10), raw[::-1][:10])
    assert np.array_equal(read(opened(server), 0, 10), raw[:10])


def test_dropped_bytes_are_requested_again(server, raw, no_reading_ahead):
    server.faults = lambda number: "altered" if number == 0 else None
    remote = opened(server)
    assert not np.array_equal(read(remote, 0, 10_000), raw[:10_000])
    assert remote.drop(0, 10_000)
    assert np.array_equal(read(remote, 0, 10_000), raw[:10_000])
    requests = server.done["requests"]
    # also those that another process has left
    forget()
    remote.drop(4096, 1)
    read(opened(server), 0, 10_000)
    assert server.done["requests"] == requests + 1


def test_a_block_that_is_damaged_on_the_disk_is_requested_again(server, raw, cache_folder):
    read(opened(server), 0, SIZE)
    for path in cache_folder.glob("*/*.block"):
        found = bytearray(path.read_bytes())
        found[1500 % len(found)] ^= 1
        path.write_bytes(found)
    forget()
    assert np.array_equal(read(opened(server), 0, 5000), raw[:5000])


def test_a_disk_that_changes_all_blocks_is_reported(server, monkeypatch):
    monkeypatch.setattr(file.Block, "_verify", lambda self, piece: False)
    with pytest.raises(OSError, match="blocks change on the disk after they were written"):
        read(opened(server), 0, 10)


def test_a_full_disk_costs_requests_only(server, raw, cache_folder, monkeypatch):
    monkeypatch.setattr(file, "IN_MEMORY", 2)
    cache_folder.write_bytes(b"a file in place of the folder")
    remote = opened(server)
    with pytest.warns(UserWarning, match="blocks can't be written to"):
        assert np.array_equal(read(remote, 0, SIZE), raw)
    assert np.array_equal(read(remote, 0, SIZE), raw)
    assert server.done["requests"] == 50
    read(remote, SIZE - 10, 10)
    assert server.done["requests"] == 50
    assert len(file._process.open) == 2


def test_the_cache_may_be_emptied_while_it_is_used(server, raw, cache_folder):
    remote = opened(server)
    for begin in range(0, SIZE, 5000):
        assert np.array_equal(read(remote, begin, 5000), raw[begin : begin + 5000])
        shutil.rmtree(cache_folder, ignore_errors=True)


def test_a_process_has_a_bounded_number_of_blocks_open(server, raw, monkeypatch):
    monkeypatch.setattr(file, "OPEN", 3)
    remote = opened(server)
    assert np.array_equal(read(remote, 0, SIZE), raw)
    assert len(file._process.open) == 3
    remote.close()
    assert not file._process.open


def test_threads_read_the_same_blocks_once(server, raw, no_reading_ahead):
    server.pause = 0.01
    remote, found = opened(server), []

    def work():
        found.append(read(remote, 0, SIZE))

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(one, raw) for one in found)
    assert server.done["bytes"] == SIZE


def _sum(remote):
    return int(read(remote, 0, SIZE).sum())


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_forked_processes_read_the_same_blocks_once(server, raw):
    remote = opened(server)
    # the parent has a connection, and a thread of fsspec
    read(remote, 0, 10)
    with multiprocessing.get_context("fork").Pool(4) as pool:
        assert pool.map(_sum, [remote] * 8) == [int(raw.sum())] * 8
    assert server.done["bytes"] == SIZE


def test_a_wait_for_another_process_ends_at_the_deadline(server, monkeypatch):
    monkeypatch.setattr(transport, "DEADLINE", 0.3)
    remote = opened(server)
    cache = file._state().cache
    with cache.claimed(remote._key, range(1), 0), pytest.raises(TimeoutError, match="another process reads the same"):
        read(remote, 0, 10)
