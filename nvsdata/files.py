"""Writing files so that nothing half-written is ever seen."""

from __future__ import annotations

import errno
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import IO, Any, Self

FLUSH_EVERY = 0.03  # s


@contextmanager
def atomic(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it takes the place of `path` if the block succeeds.

    On any exception, Ctrl-C included, the temporary file is removed and `path` is as before. FileNotFoundError names
    the folder if there is none.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(target.parent))
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part")
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        _settle(temporary)
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


@contextmanager
def flushed_early(path: Path) -> Iterator[None]:
    """While the block writes to `path`, have the disk begin: little is left for the end.

    Where the system can't flush a file's content alone, nothing is done.
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


def _settle(temporary: Path) -> None:
    """Flush to disk and give the permissions that a plain `open` would have given."""
    umask = os.umask(0)
    os.umask(umask)
    os.chmod(temporary, 0o666 & ~umask)
    with temporary.open("rb+") as file:
        os.fsync(file.fileno())


class Journal:
    """A file of JSON lines, open for adding: the first says what it belongs to, the others are what was done.

    `head`, `lines`: what the file holds, or held before; a line that was torn, as by a kill, is left out
    and mended. A file that isn't there is begun with `head`.
    """

    def __init__(self, path: Path, head: dict[str, Any]) -> None:
        self.path = path
        torn = not path.exists()
        found = [head] if torn else []
        if not torn:
            text = path.read_text(encoding="utf-8")
            parsed = [_parsed(line) for line in text.splitlines()]
            found = [line for line in parsed if line is not None]
            torn = len(found) < len(parsed) or bool(text and not text.endswith("\n"))
        self.head: dict[str, Any] = found[0] if found else {}
        self.lines = found[1:]
        self._torn = torn
        self._file: IO[str] | None = None

    def __enter__(self) -> Self:
        if self._torn:
            with atomic(self.path) as temporary:
                temporary.write_text("".join(json.dumps(line) + "\n" for line in (self.head, *self.lines)))
        self._file = self.path.open("a", encoding="utf-8")
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def add(self, line: dict[str, Any]) -> None:
        """Add a line; it is on its way to the disk when this returns."""
        assert self._file is not None, "a journal is added to within its block"
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()


def _parsed(line: str) -> dict[str, Any] | None:
    try:
        value = json.loads(line)
    except json.JSONDecodeError:
        return None
    return value if isinstance(value, dict) else None
