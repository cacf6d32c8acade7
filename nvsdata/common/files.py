"""Atomic writes, files and folders with a single writer, checksums and journals."""

from __future__ import annotations

import errno
import json
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event
from typing import IO, Any, Self

from nvsdata.common.locks import check_place, is_dead, locked, owner
from nvsdata.common.threads import during_block

try:
    # takes a tenth of zlib's time
    from isal.isal_zlib import crc32 as crc32
except ImportError:  # isal isn't available for every processor
    from zlib import crc32 as crc32

FLUSH_EVERY = 0.03  # s
PART = ".part"  # suffix of unfinished files
MOST = 1 << 30  # bytes; larger files of nvsdata's own are not read
MOST_LINES = 1 << 28  # bytes; larger journals are not read (a line takes about 250 bytes)
_SEAL = len(b"nvsdata %08x %014x\n" % (0, 0))  # bytes of the line of `sealed`
_BLOCK = 1 << 20  # bytes at the end of a written file that `put` reads back
_LONGEST = 100  # characters of a file's name that its temporary file's name contains


@contextmanager
def atomic(path: str | os.PathLike[str], *, through_link: bool = False, flush: bool = True) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`; it replaces `path` if the block succeeds.

    On any exception, including Ctrl-C, the temporary file is removed and `path` is unchanged.

    Args:
        path: the file to write.
        through_link: whether to write to the file that a link at `path` points to; for paths that the user named.
            Otherwise the link is replaced: in a folder from somebody else, it could point to any file of the user's.
        flush: whether the content must be on the disk before the file appears. A file with checksums that can be made
            again doesn't need that.

    Raises:
        FileNotFoundError: the folder doesn't exist; the error names it.
        OSError: the block or the disk failed; an error without a file name, such as for a full disk, names `path`.
    """
    target = Path(os.path.realpath(path)) if through_link and os.path.islink(path) else Path(path)
    check_place(target)
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f"{_prefix(target.name)}{owner()}-", suffix=PART)
    os.close(handle)
    temporary = Path(name)
    try:
        with named(path):
            yield temporary
            _settle(temporary, target, flush)
            os.replace(temporary, target)
    except BaseException:
        # an error of `unlink` must not hide this one; on Windows an open file stays, and `sweep` removes it later
        with suppress(OSError):
            temporary.unlink()
        raise


def _prefix(name: str) -> str:
    return f".{name[:_LONGEST]}."


def is_left_over(path: Path) -> bool:
    """Return whether a file is a temporary file of `atomic` whose process ran on this host and has ended."""
    if not (path.name.startswith(".") and path.name.endswith(PART)):
        return False
    # .NAME.HOST-PID-RANDOM.part
    return is_dead(path.name.removesuffix(PART).rpartition(".")[2].rpartition("-")[0])


def sweep(folder: Path, name: str | None = None) -> int:
    """Remove temporary files of `atomic` that killed processes left; return their number.

    Temporary files of running processes, and of processes on other hosts, stay.

    Args:
        folder: folder whose temporary files are removed: all below it or, with `name`, those directly in it.
        name: name of the file whose temporary files are removed (default None: those of all files).
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
    """Keep other processes from writing to `folder` in the block, and remove temporary files of killed processes.

    Raises:
        OutputInUse: another process writes to the folder.
    """
    with locked(folder):
        sweep(folder)
        try:
            yield
        finally:
            # temporary files of this process's children that were killed
            sweep(folder)


@contextmanager
def creating(path: Path, *, overwrite: bool) -> Iterator[None]:
    """Keep other processes from writing `path` in the block, and remove temporary files of killed processes.

    Raises:
        FileExistsError: `path` exists, unless `overwrite`.
        IsADirectoryError: `path` is a folder.
        OutputInUse: another process writes it.
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
        raise FileExistsError(f"{path} already exists: --overwrite (in Python overwrite=True) replaces it")


@contextmanager
def flushed_early(path: Path) -> Iterator[None]:
    """Flush `path` to disk repeatedly while the block writes to it, so that flushing at the end is fast.

    Does nothing on systems without `fdatasync`.
    """
    if not hasattr(os, "fdatasync"):
        yield
        return
    handle = os.open(path, os.O_RDWR)

    def flush(done: Event) -> None:
        while not done.wait(FLUSH_EVERY):
            os.fdatasync(handle)

    try:
        with during_block(flush, "nvsdata-flush"):
            yield
    finally:
        os.close(handle)


@contextmanager
def named(path: str | os.PathLike[str]) -> Iterator[None]:
    """Add `path` to OSErrors of the block that name no file, such as those of a full disk."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(path)) from None


def put(path: str | os.PathLike[str], content: bytes | memoryview, *, through_link: bool = False) -> None:
    """Write `content` to `path`, completely or not at all, and read its end back.

    Libraries that write files themselves report a full disk in many ways, or not at all. So callers let such libraries
    encode to memory, and write the bytes with this function.

    Args:
        path: the file.
        content: its new content.
        through_link: see `atomic`.

    Raises:
        OSError: the disk is full or corrupts the file; the error names `path`.
    """
    with atomic(path, through_link=through_link) as temporary:
        temporary.write_bytes(content)
        with temporary.open("rb") as file:
            file.seek(max(len(content) - _BLOCK, 0))
            if file.read() != content[-_BLOCK:]:
                raise OSError(errno.EIO, "doesn't contain what was written to it: is the disk full, or broken?")


def remove_link(path: Path) -> None:
    """Remove `path` if it is a link. For files whose names nvsdata chooses, before they are written."""
    if path.is_symlink():
        path.unlink()


def read_own(path: str | os.PathLike[str], most: int = MOST) -> bytes:
    """Return the content of a file that nvsdata wrote under a name of its own choice.

    Another program may have replaced the file. OSError for a link, for anything but a regular file, and for more than
    `most` bytes.
    """
    with open(path, "rb", opener=_open_own) as file:
        size = os.fstat(file.fileno()).st_size
        content = b"" if size > most else file.read(most + 1)
    if max(size, len(content)) > most:
        raise OSError(errno.EFBIG, f"is too large: more than {most:,} bytes", os.fspath(path))
    return content


def sealed(content: bytes) -> bytes:
    """Return a first line with the checksum and length of `content`, to be written before it; `unsealed` checks it."""
    return b"nvsdata %08x %014x\n" % (crc32(content), len(content))


def unsealed(path: str | os.PathLike[str], most: int = MOST) -> memoryview | None:
    """Return the content of a file after its first line, which `sealed` made.

    None if the file is missing, doesn't match that line, or has a content of more than `most` bytes.
    """
    try:
        with open(path, "rb", buffering=0, opener=_open_own) as file:
            size = os.fstat(file.fileno()).st_size - _SEAL
            seal = file.read(_SEAL) or b""
            # checked before the rest is read, which may be long
            if not (0 <= size <= most and seal.endswith(b" %014x\n" % size)):
                return None
            content = file.read(size) or b""
    except OSError:
        return None
    return memoryview(content) if seal == sealed(content) else None


def append_own(path: str | os.PathLike[str]) -> IO[bytes]:
    """Open a file that nvsdata wrote for appending, unbuffered; OSError for anything but a regular file."""
    return open(path, "ab", buffering=0, opener=_open_own)


def _open_own(path: str, flags: int) -> int:
    """Open a regular file without following links or waiting for a pipe; return its descriptor."""
    if os.path.islink(path):
        raise OSError(errno.ELOOP, "is a link, which nvsdata doesn't follow for its own files: remove it", path)
    handle = os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o666)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "isn't a regular file: remove it", path)
    return handle


def _settle(temporary: Path, target: Path, flush: bool) -> None:
    """Give `temporary` the permissions of `target` or, if that is new, of any new file; flush it to disk if asked."""
    try:
        mode = stat.S_IMODE(target.stat().st_mode)
    except FileNotFoundError:
        umask = os.umask(0)
        os.umask(umask)
        mode = 0o666 & ~umask
    os.chmod(temporary, mode)
    if flush:
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())


class Journal:
    """A file of JSON lines that grows as a job progresses. To be used in a `with` block.

    The first line identifies the job. Each other line describes a finished step.

    Args:
        path: the file.
        head: first line of a new file.

    Attributes:
        head: the first line, as read when the file was opened.
        lines: the other lines, as read then. A line that is cut off, such as after a kill, is left out, and the file is
            repaired.
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
            # on a full disk, closing tries to write the rest again, and fails again
            with named(self.path):
                self._file.close()

    def add(self, line: dict[str, Any]) -> None:
        """Append a line; it is on the disk when this returns."""
        assert self._file is not None, "lines are added within the `with` block"
        with named(self.path):
            write_all(self._file.fileno(), json_line(line).encode())
            os.fsync(self._file.fileno())


def write_all(handle: int, data: bytes | memoryview) -> None:
    """Write all of `data` to an open file, in several calls if the disk is nearly full; OSError if that fails."""
    view = memoryview(data).cast("B")
    while view:
        view = view[os.write(handle, view) :]


def json_line(value: dict[str, Any]) -> str:
    """Return a dict as a line of JSON for a journal or log."""
    return json.dumps(value) + "\n"


def parsed_line(line: str | bytes) -> dict[str, Any] | None:
    """Return the dict in a line of a journal; None for a line that is cut off."""
    try:
        value = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None
