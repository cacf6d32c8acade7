"""Writing files so that a half-written file never appears."""

from __future__ import annotations

import errno
import json
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread
from typing import IO, Any, Self

from nvsdata.common.locks import check_place, is_dead, locked, owner

try:
    # a tenth of zlib's time
    from isal.isal_zlib import crc32 as crc32
except ImportError:  # isal isn't available for every processor
    from zlib import crc32 as crc32

FLUSH_EVERY = 0.03  # s
PART = ".part"  # suffix of unfinished files
MOST = 1 << 30  # bytes of a file of our own that are read
MOST_LINES = 1 << 28  # bytes of a journal, of which a line takes about 250
_SEAL = len(b"nvsdata %08x %014x\n" % (0, 0))  # bytes
_BLOCK = 1 << 20  # bytes that are read back
_LONGEST = 100  # characters of a file's name that its temporary file's name contains


@contextmanager
def atomic(path: str | os.PathLike[str], *, through_link: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it replaces `path` if the block succeeds.

    A link at `path` is replaced, too: whoever sent a folder of recordings could have put one there that leads to any
    file of the user's. Only for a path that the user named, `through_link` writes to where the link points.

    On any exception, Ctrl-C included, the temporary file is removed and `path` is as before. An OSError of the block
    that names no file, such as that of a full disk, names `path`. FileNotFoundError, which names the folder, if the
    folder doesn't exist.
    """
    target = Path(os.path.realpath(path)) if through_link and os.path.islink(path) else Path(path)
    check_place(target)
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f"{_prefix(target.name)}{owner()}-", suffix=PART)
    os.close(handle)
    temporary = Path(name)
    try:
        with named(path):
            yield temporary
            _settle(temporary, target)
            os.replace(temporary, target)
    except BaseException:
        # what went wrong is more important; on Windows the file may still be open, and `sweep` removes it later
        with suppress(OSError):
            temporary.unlink()
        raise


def _prefix(name: str) -> str:
    return f".{name[:_LONGEST]}."


def is_left_over(path: Path) -> bool:
    """Whether a file is a temporary one of `atomic` whose process, on this host, has ended."""
    if not (path.name.startswith(".") and path.name.endswith(PART)):
        return False
    # .NAME.HOST-PID-RANDOM.part
    return is_dead(path.name.removesuffix(PART).rpartition(".")[2].rpartition("-")[0])


def sweep(folder: Path, name: str | None = None) -> int:
    """Remove temporary files of `atomic` that killed processes left; returns how many there were.

    - `folder`: where to look: everywhere below it or, with `name`, directly in it
    - `name`: only temporary files of the file of this name; None: of all

    Temporary files of running processes, and of processes on other hosts, stay.
    """
    found = folder.rglob(f".*{PART}") if name is None else folder.glob(f".*{PART}")
    count = 0
    for part in found:
        if (name is None or part.name.startswith(_prefix(name))) and is_left_over(part):
            part.unlink(missing_ok=True)
            count += 1
    return count


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Be the only process that writes to `folder` while the block runs; leftovers of killed ones are removed first.

    Raises OutputInUse if another process already writes to it.
    """
    with locked(folder):
        sweep(folder)
        try:
            yield
        finally:
            # leftovers of this process's own children that were killed
            sweep(folder)


@contextmanager
def creating(path: Path, *, overwrite: bool) -> Iterator[None]:
    """Be the only process that writes the file `path` while the block runs; leftovers of killed ones are removed.

    Raises FileExistsError if `path` exists, unless `overwrite`; IsADirectoryError if it is a folder; OutputInUse if
    another process writes it.
    """
    _refuse(path, overwrite)
    with locked(path):
        # another process may have finished it in the meantime
        _refuse(path, overwrite)
        sweep(path.parent, path.name)
        yield


def _refuse(path: Path, overwrite: bool) -> None:
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if os.path.lexists(path) and not overwrite:
        raise FileExistsError(f"{path} is there already: --overwrite (overwrite=True) replaces it")


@contextmanager
def flushed_early(path: Path) -> Iterator[None]:
    """Flush `path` to disk while the block writes to it, so that little is left for the end.

    Does nothing on systems without `fdatasync`.
    """
    if not hasattr(os, "fdatasync"):
        yield
        return
    done = Event()
    handle = os.open(path, os.O_RDWR)

    def flush() -> None:
        while not done.wait(FLUSH_EVERY):
            os.fdatasync(handle)

    thread = Thread(target=flush, name="nvsdata-flush", daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        os.close(handle)


@contextmanager
def named(path: str | os.PathLike[str]) -> Iterator[None]:
    """Make OSErrors of the block name `path`: those of a full disk name no file by themselves."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(path)) from None


def put(path: str | os.PathLike[str], content: bytes | memoryview, *, through_link: bool = False) -> None:
    """Write `content` to `path`, whole or not at all. OSError, which names `path`, if the disk is full or corrupts it.

    `through_link`: see `atomic`.

    Libraries that write files themselves report a full disk in many ways, or not at all; so let them make bytes.
    """
    with atomic(path, through_link=through_link) as temporary:
        temporary.write_bytes(content)
        with temporary.open("rb") as file:
            file.seek(max(len(content) - _BLOCK, 0))
            if file.read() != content[-_BLOCK:]:
                raise OSError(errno.EIO, "doesn't hold what was written to it: is the disk full, or broken?")


def remove_link(path: Path) -> None:
    """Remove a link in the place of a file that nvsdata is to write under a name of its own."""
    if path.is_symlink():
        path.unlink()


def read_own(path: str | os.PathLike[str], most: int = MOST) -> bytes:
    """Return the content of a file that nvsdata wrote under a name of its own, and that anybody may have changed since.

    OSError for a link, for anything but a regular file, and for more than `most` bytes (default 1 GiB).
    """
    with open(path, "rb", opener=_open_own) as file:
        size = os.fstat(file.fileno()).st_size
        content = b"" if size > most else file.read(most + 1)
    if max(size, len(content)) > most:
        raise OSError(errno.EFBIG, f"is too large: more than {most:,} bytes", os.fspath(path))
    return content


def sealed(content: bytes) -> bytes:
    """Return what precedes `content` in a file, for `unsealed`: its checksum and length."""
    return b"nvsdata %08x %014x\n" % (crc32(content), len(content))


def unsealed(path: str | os.PathLike[str], most: int = MOST) -> memoryview | None:
    """Return what follows the seal in a file of our own; None if there is none, it is damaged or over `most` bytes."""
    try:
        with open(path, "rb", buffering=0, opener=_open_own) as file:
            size = os.fstat(file.fileno()).st_size - _SEAL
            seal = file.read(_SEAL) or b""
            # before the rest is read, which may be long
            if not (0 <= size <= most and seal.endswith(b" %014x\n" % size)):
                return None
            content = file.read(size) or b""
    except OSError:
        return None
    return memoryview(content) if seal == sealed(content) else None


def append_own(path: str | os.PathLike[str]) -> IO[bytes]:
    """Open a file of nvsdata's own for appending, unbuffered; OSError for anything but a regular file."""
    return open(path, "ab", buffering=0, opener=_open_own)


def _open_own(path: str, flags: int) -> int:
    """Open a regular file, and wait for no pipe."""
    if os.path.islink(path):
        raise OSError(errno.ELOOP, "is a link, which nvsdata doesn't follow for files of its own: remove it", path)
    handle = os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o666)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "isn't a regular file: remove it", path)
    return handle


def _settle(temporary: Path, target: Path) -> None:
    """Flush to disk, and set the permissions of `target` or, if it is new, those that a plain `open` would give."""
    try:
        mode = stat.S_IMODE(target.stat().st_mode)
    except FileNotFoundError:
        umask = os.umask(0)
        os.umask(umask)
        mode = 0o666 & ~umask
    os.chmod(temporary, mode)
    with temporary.open("rb+") as file:
        os.fsync(file.fileno())


class Journal:
    """A file of JSON lines that is appended to: the first line says what it belongs to, the others what was done.

    - `path`: the file; a new one begins with `head`
    - `head`, `lines`: the first line and the others, as the file held them when it was opened. A torn line, such as
      after a kill, is left out, and the file is repaired
    """

    def __init__(self, path: Path, head: dict[str, Any]) -> None:
        self.path = path
        torn = not path.exists()
        found = [head] if torn else []
        if not torn:
            text = read_own(path, MOST_LINES).decode("utf-8", "replace")
            parsed = [parsed_line(line) for line in text.splitlines()]
            found = [line for line in parsed if line is not None]
            torn = len(found) < len(parsed) or bool(text and not text.endswith("\n"))
        self.head: dict[str, Any] = found[0] if found else {}
        self.lines = found[1:]
        self._torn = torn
        self._file: IO[bytes] | None = None

    def __enter__(self) -> Self:
        if self._torn:
            with atomic(self.path) as temporary:
                temporary.write_text("".join(map(json_line, (self.head, *self.lines))))
        self._file = append_own(self.path)
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            # what a full disk didn't take is written again, and fails again
            with named(self.path):
                self._file.close()

    def add(self, line: dict[str, Any]) -> None:
        """Append a line; it is on the disk when this returns."""
        assert self._file is not None, "a journal is added to within its block"
        with named(self.path):
            write_all(self._file.fileno(), json_line(line).encode())
            os.fsync(self._file.fileno())


def write_all(handle: int, data: bytes | memoryview) -> None:
    """Write all of `data` to an open file, or raise OSError: a nearly full disk takes only a part at first."""
    view = memoryview(data).cast("B")
    while view:
        view = view[os.write(handle, view) :]


def json_line(value: dict[str, Any]) -> str:
    """A line of a journal or log."""
    return json.dumps(value) + "\n"


def parsed_line(line: str | bytes) -> dict[str, Any] | None:
    """What a line of a journal says; None for one that is torn."""
    try:
        value = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None
