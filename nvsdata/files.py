"""Writing files so that nothing half-written is ever seen."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

FLUSH_EVERY = 0.03  # s


@contextmanager
def atomic(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it takes the place of `path` if the block succeeds.

    On any exception, Ctrl-C included, the temporary file is removed and `path` is as before.
    """
    target = Path(path)
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


def json_lines(path: Path) -> tuple[list[dict[str, Any]], bool]:
    """The objects of a file of JSON lines, and whether a line was torn, as by a kill, and is left out."""
    text = path.read_text(encoding="utf-8")
    found = []
    torn = bool(text) and not text.endswith("\n")
    for line in text.splitlines():
        try:
            value = json.loads(line)
        except json.JSONDecodeError:
            value = None
        if isinstance(value, dict):
            found.append(value)
        else:
            torn = True
    return found, torn
