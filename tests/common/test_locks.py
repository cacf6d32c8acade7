import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes_of_others import another_process, dead_owner

from nvsdata.common.files import claimed
from nvsdata.common.locks import OutputInUse, is_dead, is_locked, lock_path, locked, owner

HOLD = """
    import sys
    from nvsdata.common.locks import locked
    with locked({path!r}):
        print("held", flush=True)
        sys.stdin.read()
"""


def test_the_second_is_told_who_the_first_is(output):
    with another_process(HOLD.format(path=str(output))) as (first, _):
        with (
            pytest.raises(OutputInUse, match=rf"out is being written by process {first.pid} on .*since 20\d\d-"),
            locked(output),
        ):
            pass
        assert lock_path(output).exists()
        first.communicate("")
    with locked(output):
        pass
    assert not lock_path(output).exists()


def test_whether_a_process_writes_is_asked_without_a_trace(output, monkeypatch):
    assert not is_locked(output)
    assert not lock_path(output).exists()
    with another_process(HOLD.format(path=str(output))) as (first, _):
        before = lock_path(output).read_bytes()
        assert is_locked(output)
        assert lock_path(output).read_bytes() == before
        first.kill()
        first.wait()
        assert not is_locked(output)
        assert lock_path(output).exists()
    with locked(output):
        assert is_locked(output)
        # another user's lock may not be opened
        with monkeypatch.context() as patched:
            patched.setattr(os, "open", lambda *_: exec("raise PermissionError"))
            assert is_locked(output)


def test_a_lock_dies_with_its_process(output):
    with another_process(HOLD.format(path=str(output))) as (first, _):
        first.kill()
        first.wait()
        assert lock_path(output).exists()
        with locked(output):
            assert json.loads(lock_path(output).read_text())["pid"] == os.getpid()
    assert not lock_path(output).exists()


def test_nor_may_one_process_have_it_twice(output):
    with locked(output), pytest.raises(OutputInUse), locked(output):
        pass


def test_a_damaged_lock_file_is_no_obstacle(output):
    for left in (b"", b'{"own', b'{"owner": "12'):
        lock_path(output).write_bytes(left)
        with locked(output):
            pass


@pytest.mark.skipif(os.name != "posix", reason="links and pipes as POSIX has them")
def test_what_is_no_lock_is_not_overwritten(output, tmp_path):
    place = lock_path(output)

    def refused():
        with pytest.raises(FileExistsError, match="is not a lock of nvsdata's"), locked(output):
            pass

    place.write_text("precious")
    refused()
    assert place.read_text() == "precious"
    place.unlink()
    (tmp_path / "target").write_text("precious")
    for target in ("target", "nowhere"):
        place.symlink_to(tmp_path / target)
        refused()
        place.unlink()
    assert (tmp_path / "target").read_text() == "precious"
    assert not (tmp_path / "nowhere").exists()
    os.mkfifo(place)
    refused()


def test_without_locks_of_the_system_the_name_in_the_file_decides(output, monkeypatch):
    monkeypatch.setattr("nvsdata.common.locks._try_lock", lambda file: None)
    lock_path(output).write_text(json.dumps({"owner": "ffffff-1", "host": "elsewhere", "pid": 1}))
    with pytest.raises(OutputInUse, match="process 1 on elsewhere"), locked(output):
        pass
    lock_path(output).write_text(json.dumps({"owner": dead_owner()}))
    with locked(output):
        pass


def test_of_many_at_once_only_one_has_it(tmp_path):
    """The lock file is removed by the one that had it, while others wait to open it."""
    counter = tmp_path / "counter"
    counter.write_text("0")
    code = """
        import sys, time
        from nvsdata.common.locks import OutputInUse, locked
        print("ready", flush=True)
        sys.stdin.readline()
        done = 0
        while done < 25:
            try:
                with locked({path!r}):
                    n = int(open({counter!r}).read())
                    time.sleep(0.0005)
                    open({counter!r}, "w").write(str(n + 1))
                done += 1
            except OutputInUse:
                time.sleep(0.0003)
    """
    code = code.format(path=str(tmp_path / "out"), counter=str(counter))
    with another_process(code) as (a, _), another_process(code) as (b, _), another_process(code) as (c, _):
        for process in (a, b, c):
            process.stdin.write("go\n")
            process.stdin.flush()
        for process in (a, b, c):
            assert process.wait(timeout=60) == 0
    assert counter.read_text() == "75"


def test_owners_are_told_dead_from_alive():
    assert not is_dead(owner())
    assert is_dead(dead_owner())
    assert not is_dead("ffffff-1")
    assert not is_dead("nonsense")


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="zombies as Linux shows them")
def test_a_zombie_is_dead():
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    name = f"{owner().rpartition('-')[0]}-{process.pid}"
    assert not is_dead(name)
    process.stdin.close()
    deadline = time.monotonic() + 30
    # not waited for: it stays a zombie
    while not is_dead(name):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.wait()


def test_a_claimed_folder_is_swept(tmp_path):
    part = tmp_path / f".a.h5.{dead_owner()}-x1.part"
    part.touch()
    with claimed(tmp_path):
        assert not part.exists()
        with pytest.raises(OutputInUse), claimed(tmp_path):
            pass
    assert not list(tmp_path.iterdir())


def test_a_missing_folder_and_a_name_as_long_as_the_system_allows(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none'$"), locked(tmp_path / "none" / "a.h5"):
        pass
    with locked(tmp_path / ("n" * 252 + ".h5")), pytest.raises(OutputInUse), locked(tmp_path / ("n" * 252 + ".h5")):
        pass


def test_a_full_disk_leaves_a_lock_unsigned_but_locked(tmp_path):
    from disks import file_limit

    with file_limit(0), locked(tmp_path / "a"):
        assert (tmp_path / ".a.lock").read_bytes() == b""
        with pytest.raises(OutputInUse), locked(tmp_path / "a"):
            pass
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes as POSIX has them")
@pytest.mark.parametrize("make", [os.mkfifo, Path.mkdir, lambda place: place.symlink_to(place)])
def test_what_is_no_lock_is_not_waited_for(output, make):
    make(lock_path(output))
    assert not is_locked(output)
    with pytest.raises(FileExistsError, match="is not a lock of nvsdata's"), locked(output):
        pass


@pytest.mark.parametrize("content", [b'{"owner": ' + b"[" * 50_000, b'{"owner": ' + b" " * (1 << 20)])
def test_a_lock_of_deep_or_long_content_is_taken_over(output, content):
    lock_path(output).write_bytes(content)
    assert not is_locked(output)
    with locked(output):
        assert is_locked(output)
