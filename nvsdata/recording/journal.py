"""Copy of a camera's stream on disk, from which an unfinished recording can be completed."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Iterator
from pathlib import Path

from nvsdata.common.errors import shown
from nvsdata.common.files import named, write_all
from nvsdata.common.locks import OutputInUse, locked

SUFFIX = ".davis"
SETTLED = 1.0  # s between flushes of written data to the disk


def journal_of(path: Path) -> Path:
    """Return the path of a recording's journal, next to the recording."""
    return path.with_name(path.name + SUFFIX)


class StreamJournal:
    """Journal of a recording: `head`, which describes how to decode the stream, and then the stream.

    Blocks that were passed to `write` stay on the disk if the process is killed.

    Raises:
        FileExistsError: There is a journal already, which belongs to a recording that wasn't finished.
    """

    def __init__(self, path: Path, head: bytes) -> None:
        self.path = journal_of(path)
        self.size = 0
        check_finished(path)
        how = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        self._handle: int | None = os.open(self.path, how, 0o666)
        self._settled = time.monotonic()
        try:
            self._put(head)
        except BaseException:
            self.remove()
            raise

    def write(self, block: bytes) -> None:
        """Append a block of the stream; raise OSError if it can't be written completely."""
        self.size += len(block)
        self._put(block)
        now = time.monotonic()
        if self._handle is not None and now - self._settled > SETTLED:
            getattr(os, "fdatasync", os.fsync)(self._handle)
            self._settled = now

    def _put(self, data: bytes) -> None:
        assert self._handle is not None, "the journal is closed"
        with named(self.path):
            write_all(self._handle, data)

    def remove(self) -> None:
        """Delete the journal, because the recording itself is complete."""
        self.size = 0
        self.close()

    def close(self) -> None:
        """Close the file; a second call does nothing. A journal without a block of the stream is deleted."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
            if not self.size:
                self.path.unlink(missing_ok=True)


def left_over_message(journal: Path) -> str:
    """Return a message about the journal of an unfinished recording, with the command that finishes the recording."""
    command = shlex.join(("nvsdata", "convert", str(journal), str(journal.with_suffix(""))))
    return f"{shown(journal)} is a recording that wasn't finished: `{shown(command)}` finishes it"


def check_finished(path: Path) -> None:
    """Raise FileExistsError if an earlier recording to this file wasn't finished, so that its journal exists."""
    if (journal := journal_of(path)).exists():
        raise FileExistsError(left_over_message(journal))


def left_over(folder: Path) -> Iterator[Path]:
    """Yield journals in a folder that no process writes to any more."""
    for journal in sorted(folder.glob(f"*.*{SUFFIX}")):
        try:
            with locked(journal.with_suffix("")):
                yield journal
        except OutputInUse:
            continue
