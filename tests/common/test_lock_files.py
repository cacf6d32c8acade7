"""Where locks stand, what they say, and how systems without some of it are met."""

import errno
import json
import os
import stat
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from processes_of_others import dead_owner

from nvsdata.common import locks
from nvsdata.common.locks import OutputInUse, check_place, is_dead, lock_path, locked, owner


def test_a_folder_that_is_not_there_is_named(tmp_path):
    check_place(tmp_path / "a.h5")
    with pytest.raises(FileNotFoundError) as missing:
        check_place(tmp_path / "b/a.h5")
    assert (missing.value.errno, missing.value.filename) == (errno.ENOENT, str(tmp_path / "b"))


def test_where_locks_stand(tmp_path):
    (tmp_path / "folder").mkdir()
    assert lock_path(tmp_path / "folder") == tmp_path / "folder" / ".nvsdata.lock"
    assert lock_path(str(tmp_path / "a.h5")) == tmp_path / ".a.h5.lock"
    # what the system allows is counted in bytes
    for longest in ("n" * 240, "μ" * 120):
        assert lock_path(tmp_path / longest) == tmp_path / f".{longest}.lock"
        other = lock_path(tmp_path / f"{longest}n")
        assert len(other.name) == 1 + 64 + 5
        assert other != lock_path(tmp_path / f"{longest}m")
        with locked(tmp_path / longest):
            pass


@pytest.mark.skipif(os.name != "posix", reason="locks as POSIX has them")
@pytest.mark.parametrize(
    ("number", "expected"),
    [
        *((number, None) for number in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS, errno.EINVAL)),
        (errno.EWOULDBLOCK, False),
        (errno.EIO, False),
    ],
)
def test_a_file_system_without_locks_is_told_from_a_lock_that_is_taken(tmp_path, monkeypatch, number, expected):
    def flock(file, how):
        raise OSError(number, "no")

    with (tmp_path / "a").open("w") as file:
        assert locks._try_lock(file) is True
        monkeypatch.setattr("fcntl.flock", flock)
        assert locks._try_lock(file) is expected


def test_without_locks_of_the_system_ones_own_name_is_no_obstacle(output, monkeypatch):
    monkeypatch.setattr("nvsdata.common.locks._try_lock", lambda file: None)
    for left in ("", json.dumps({"owner": owner()})):
        lock_path(output).write_text(left)
        with locked(output):
            assert json.loads(lock_path(output).read_text())["owner"] == owner()
    assert not lock_path(output).exists()


def test_what_a_lock_says(output, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["/usr/bin/nvsdata", "convert", "a b"])
    with locked(output):
        said = json.loads(lock_path(output).read_text())
        with pytest.raises(OutputInUse) as raised, locked(output):
            pass
    assert list(said) == ["owner", "host", "pid", "command", "since"]
    assert (said["owner"], said["pid"], said["command"]) == (owner(), os.getpid(), "nvsdata convert a b")
    who = f"process {said['pid']} on {said['host']} (nvsdata convert a b), since {said['since']}"
    assert str(raised.value) == f"{output} is being written by {who}"
    monkeypatch.setattr(sys, "argv", [])
    with locked(output):
        assert json.loads(lock_path(output).read_text())["command"] == ""


def test_a_lock_that_says_nothing_holds_all_the_same(output):
    # locks begin like this; what follows was lost
    with locked(output):
        lock_path(output).write_bytes(b'{"owner": ')
        with pytest.raises(OutputInUse, match=r"written by process \? on \? \(\?\), since \?$"), locked(output):
            pass
        assert lock_path(output).exists()


def test_a_lock_of_another_inode_is_not_the_lock(tmp_path):
    (tmp_path / "a").touch()
    with (tmp_path / "a").open() as file:
        assert locks._is_still(file, tmp_path / "a")
        (tmp_path / "b").touch()
        (tmp_path / "b").replace(tmp_path / "a")
        assert not locks._is_still(file, tmp_path / "a")
        (tmp_path / "a").unlink()
        assert not locks._is_still(file, tmp_path / "a")


def test_names_of_processes(monkeypatch):
    host, _, number = owner().rpartition("-")
    assert number == str(os.getpid())
    assert len(host) == 6
    assert int(host, 16) >= 0
    dead = dead_owner()
    for name in (f"{dead}x", f"x{dead}", f"{host}-", f"{host}--1", dead.replace("-", "")):
        assert not is_dead(name)

    def stat(path):
        raise OSError

    monkeypatch.setattr("nvsdata.common.locks.os.stat", stat)
    # without namespaces of processes, the host alone decides
    assert len(owner().rpartition("-")[0]) == 6
    assert owner() == owner()


@pytest.mark.skipif(os.name != "posix", reason="processes as POSIX has them")
def test_a_process_of_somebody_else_is_alive(monkeypatch):
    def kill(pid, number):
        assert number == 0
        raise PermissionError

    monkeypatch.setattr(os, "kill", kill)
    assert not is_dead(dead_owner())


@pytest.mark.parametrize(("platform", "times"), [("linux", 1), ("win32", 2)])
def test_a_lock_file_is_removed_before_the_lock_is_given_up(tmp_path, monkeypatch, platform, times):
    """On Windows, where an open file can't be removed, once more after it."""
    removed, unlink = [], Path.unlink

    def recorded(path, missing_ok=False):
        removed.append(path)
        unlink(path, missing_ok)

    monkeypatch.setattr(locks, "_try_lock", lambda file: True)
    with locked(tmp_path / "a"):
        monkeypatch.setattr(Path, "unlink", recorded)
        monkeypatch.setattr(sys, "platform", platform)
    assert removed == [lock_path(tmp_path / "a")] * times


def test_locks_as_windows_has_them(tmp_path, monkeypatch):
    """Others can't read bytes that are locked, so it's one far behind what the file says."""
    asked, error = [], None

    def locking(handle, mode, count):
        asked.append((os.lseek(handle, 0, os.SEEK_CUR), mode, count))
        if error is not None:
            raise error

    dead = dead_owner()
    with (tmp_path / "a").open("w+") as file:
        monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(LK_NBLCK=7, locking=locking))
        monkeypatch.setattr(sys, "platform", "win32")
        assert locks._try_lock(file) is True
        assert asked == [(1 << 30, 7, 1)]
        # what it says stands at the beginning all the same
        assert os.lseek(file.fileno(), 0, os.SEEK_CUR) == 0
        error = OSError(errno.EACCES, "taken")
        assert locks._try_lock(file) is False
    # asking would end the process
    assert not is_dead(dead)


@pytest.mark.skipif(os.name != "posix", reason="permissions as POSIX has them")
def test_everybody_may_take_over_a_lock_as_far_as_the_umask_says(tmp_path):
    before = os.umask(0o002)
    try:
        with locked(tmp_path / "a"):
            assert stat.S_IMODE(lock_path(tmp_path / "a").stat().st_mode) == 0o664
    finally:
        os.umask(before)


def test_locks_where_links_cannot_be_told_apart(output, monkeypatch):
    for name in ("O_NOFOLLOW", "O_NONBLOCK"):
        monkeypatch.delattr(os, name, raising=False)
    with locked(output), pytest.raises(OutputInUse, match=f"process {os.getpid()} on"), locked(output):
        pass


@pytest.mark.skipif(os.name != "posix", reason="processes as POSIX has them")
@pytest.mark.parametrize("state", [b"", b"12 (a b) c", OSError])
def test_a_process_of_which_nothing_is_known_is_alive(monkeypatch, state):
    def read_bytes(path):
        assert path.name == "stat"
        if state is OSError:
            raise OSError(errno.ENOENT, "no")
        return state

    monkeypatch.setattr(Path, "read_bytes", read_bytes)
    assert not is_dead(owner())


@pytest.mark.skipif(os.name != "posix", reason="processes as POSIX has them")
@pytest.mark.parametrize(("state", "dead"), [(b"Z", True), (b"X", True), (b"S", False), (b"R", False), (b"T", False)])
def test_the_state_is_what_follows_the_name(monkeypatch, state, dead):
    monkeypatch.setattr(Path, "read_bytes", lambda path: b"12 (a) Z (b)) " + state + b" 1 12 R Z")
    assert is_dead(owner()) == dead
