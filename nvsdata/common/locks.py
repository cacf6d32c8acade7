"""Locks that let one process at a time write an output, and process names that show who wrote a file."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import socket
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from nvsdata.common.errors import shown

FOLDER_LOCK = ".nvsdata.lock"
_UNSUPPORTED = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS, errno.EINVAL)  # file systems without locks
_MARK = b'{"owner": '  # first bytes of a lock file
_LONGEST = 240  # bytes; a lock file's name can contain a file name of at most this length
_MOST = 1 << 20  # bytes of a lock file that are read
_UNFOLLOWED = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)  # no link is followed, no pipe waited for
_BEYOND = 1 << 30  # on Windows, the byte to lock: beyond the content, because other processes can't read locked bytes


class OutputInUse(OSError):
    """Another process writes to the same file or folder; the message names the process."""


def check_place(path: Path) -> None:
    """Raise FileNotFoundError, which names the folder, unless the folder of the file `path` exists."""
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path.parent))


@contextmanager
def locked(output: str | os.PathLike[str]) -> Iterator[None]:
    """Keep other processes from writing to `output`, a file or a folder, while the block runs.

    The lock is a file with host, process and command: `.NAME.lock` next to a file, `.nvsdata.lock` in an existing
    folder. The system releases the lock when the process ends, however it ends, so the lock file of a dead process is
    taken over. On a file system without locks, the host and process number in the lock file show whether its process is
    alive; a process of another host counts as alive.

    Raises:
        OutputInUse: another process (or thread) has the lock.
        FileNotFoundError: the folder doesn't exist.
    """
    place = lock_path(output)
    check_place(place)
    file = _acquired(place, output)
    try:
        yield
    finally:
        # removed before the lock is released: a process that then locks this inode sees that the name is gone
        with suppress(OSError):
            place.unlink()
        file.close()
        if sys.platform == "win32":
            # on Windows an open file can't be removed
            with suppress(OSError):
                place.unlink()


def is_locked(output: str | os.PathLike[str]) -> bool:
    """Return whether a process writes to `output`, as far as this user can see; nothing is created or changed."""
    try:
        handle = os.open(lock_path(output), os.O_RDONLY | _UNFOLLOWED)
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            os.close(handle)
            return False  # not a lock of nvsdata's
        with open(handle, encoding="utf-8") as file:
            if is_dead(str(_holder(file).get("owner"))):
                return False
            # the owner is on another host, or its number now belongs to a new process
            return _try_lock(file, shared=True) is not True
    except FileNotFoundError:
        return False
    except PermissionError:
        return True
    except OSError:
        # a link: not a lock of nvsdata's
        return False


def is_dead_lock(path: Path) -> bool:
    """Return whether a file is the lock of a process on this host that has ended."""
    if not (path.name == FOLDER_LOCK or (path.name.startswith(".") and path.name.endswith(".lock"))):
        return False
    try:
        if path.is_symlink() or not stat.S_ISREG(path.lstat().st_mode) or path.stat().st_size > _MOST:
            return False
        with path.open(encoding="utf-8") as file:
            if path.name == FOLDER_LOCK and not path.stat().st_size:
                # the process ended before it wrote its name; an empty file of another name may be another program's
                return _try_lock(file, shared=True) is True
            return is_dead(str(_holder(file).get("owner"))) and _try_lock(file, shared=True) is not False
    except (OSError, ValueError):
        return False


def remove_dead_lock(path: Path) -> None:
    """Remove the lock of a process that has ended, unless another process has taken it over in the meantime."""
    with suppress(OSError), open(os.open(path, os.O_RDWR | _UNFOLLOWED), "r+", encoding="utf-8") as file:
        if _try_lock(file) is not False and is_dead(str(_holder(file).get("owner"))) and _is_still(file, path):
            path.unlink()


def lock_path(output: str | os.PathLike[str]) -> Path:
    """Return the path of an output's lock file."""
    target = Path(output)
    if target.is_dir():
        return target / FOLDER_LOCK
    name = target.name
    if len(os.fsencode(name)) > _LONGEST:
        name = hashlib.sha256(os.fsencode(name)).hexdigest()
    return target.with_name(f".{name}.lock")


def owner() -> str:
    """Return this process's name, made of host and process number, which `is_dead` understands."""
    return f"{_host()}-{os.getpid()}"


def is_dead(name: str) -> bool:
    """Return whether the process called `name` by `owner` ran on this host and has ended; False if unknown."""
    host, _, number = name.rpartition("-")
    return host == _host() and number.isdecimal() and not _alive(int(number))


def _host() -> str:
    """Return six hexadecimal digits for this host and, in a container, for its process namespace."""
    try:
        space = os.stat("/proc/self/ns/pid").st_ino
    except OSError:
        space = 0
    return hashlib.sha256(f"{socket.gethostname()} {space}".encode()).hexdigest()[:6]


def _alive(pid: int) -> bool:
    if sys.platform == "win32":
        return True  # os.kill would end the process on Windows
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    try:
        state = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[0]
    except (OSError, IndexError):
        return True
    # Z: ended, but not reaped; in a container without an init process that may stay so
    return state not in (b"Z", b"X")


def _acquired(place: Path, output: str | os.PathLike[str]) -> IO[str]:
    """Return the lock file, locked, with this process written into it as the owner."""
    while True:
        # an existing file is opened as it is: it may belong to another process, or be left by a dead one
        try:
            file = os.fdopen(os.open(place, os.O_RDWR | os.O_CREAT | _UNFOLLOWED, 0o666), "r+", encoding="utf-8")
        except (OSError, ValueError):
            _refuse_others(place)
            raise
        free: bool | None = False
        try:
            _refuse_others(place)
            free = _try_lock(file)
            held = _holder(file)
            if free is None:  # the file system has no locks
                free = not held or is_dead(str(held.get("owner"))) or held.get("owner") == owner()
            if not free:
                who = f"process {held.get('pid', '?')} on {held.get('host', '?')} ({held.get('command', '?')})"
                message = f"{os.fspath(output)} is being written by {who}, since {held.get('since', '?')}"
                raise OutputInUse(shown(message))
            if _is_still(file, place):
                _sign(file)
                return file
        except BaseException:
            # a lock file without an owner, left by a signal, couldn't be distinguished from another program's file
            if free and _is_still(file, place):
                place.unlink()
            file.close()
            raise
        file.close()


def _refuse_others(place: Path) -> None:
    """Raise FileExistsError if `place` is a file but not a lock, because the lock would overwrite it."""
    with suppress(FileNotFoundError):
        status = place.lstat()
        # a lock cut off by a full disk or a kill is empty, or begins like one
        if not stat.S_ISREG(status.st_mode) or not _MARK.startswith(_head(place)):
            raise FileExistsError(f"{place} is not a lock of nvsdata's: move it away")


def _head(place: Path) -> bytes:
    with place.open("rb") as file:
        return file.read(len(_MARK))


def _try_lock(file: IO[str], *, shared: bool = False) -> bool | None:
    """Try to take the lock without waiting; return whether it was free, or None if the file system has no locks."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(file.fileno(), _BEYOND, os.SEEK_SET)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            os.lseek(file.fileno(), 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        return None if error.errno in _UNSUPPORTED else False
    return True


def _is_still(file: IO[str], place: Path) -> bool:
    """Return whether `place` is still the locked file: another process may have removed it meanwhile."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), os.stat(place))
    except FileNotFoundError:
        return False


def _holder(file: IO[str]) -> dict[str, Any]:
    file.seek(0)
    try:
        found = json.loads(file.read(_MOST))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _sign(file: IO[str]) -> None:
    command = " ".join((Path(sys.argv[0]).name, *sys.argv[1:])) if sys.argv else ""
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    entry = {"owner": owner(), "host": socket.gethostname(), "pid": os.getpid(), "command": command, "since": since}
    # on a full disk the lock file stays unsigned, but the lock is valid; unbuffered, or closing it would fail again
    with suppress(OSError):
        file.seek(0)
        os.ftruncate(file.fileno(), 0)
        os.write(file.fileno(), json.dumps(entry, ensure_ascii=True).encode())
