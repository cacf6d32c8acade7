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

FLUSH_EVERY = 0.03  # s
PART = ".part"  # suffix of unfinished files
_BLOCK = 1 << 20  # bytes that are read back
_LONGEST = 100  # characters of a file's name that its temporary file's name contains


@contextmanager
def atomic(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it replaces `path` if the block succeeds.

    On any exception, Ctrl-C included, the temporary file is removed and `path` is as before. OSErrors of the block that
    name no file name `path`. FileNotFoundError, which names the folder, if the folder doesn't exist.
    """
    # a plain `open` would also write to where a link points
    target = Path(os.path.realpath(path)) if os.path.islink(path) else Path(path)
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


def put(path: str | os.PathLike[str], content: bytes | memoryview) -> None:
    """Write `content` to `path`, whole or not at all. OSError, which names `path`, if the disk is full or corrupts it.

    Libraries that write files themselves report a full disk in many ways, or not at all; so let them make bytes.
    """
    with atomic(path) as temporary:
        temporary.write_bytes(content)
        with temporary.open("rb") as file:
            file.seek(max(len(content) - _BLOCK, 0))
            if file.read() != content[-_BLOCK:]:
                raise OSError(errno.EIO, "doesn't hold what was written to it: is the disk full, or broken?")


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
            text = path.read_text(encoding="utf-8")
            parsed = [parsed_line(line) for line in text.splitlines()]
            found = [line for line in parsed if line is not None]
            torn = len(found) < len(parsed) or bool(text and not text.endswith("\n"))
        self.head: dict[str, Any] = found[0] if found else {}
        self.lines = found[1:]
        self._torn = torn
        self._file: IO[str] | None = None

    def __enter__(self) -> Self:
        if self._torn:
            with atomic(self.path) as temporary:
                temporary.write_text("".join(map(json_line, (self.head, *self.lines))))
        self._file = self.path.open("a", encoding="utf-8")
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
            self._file.write(json_line(line))
            self._file.flush()
            os.fsync(self._file.fileno())


def json_line(value: dict[str, Any]) -> str:
    """A line of a journal or log."""
    return json.dumps(value) + "\n"


def parsed_line(line: str | bytes) -> dict[str, Any] | None:
    """What a line of a journal says; None for one that is torn."""
    try:
        value = json.loads(line)
    except ValueError:
        return None
    return value if isinstance(value, dict) else None
