"""Exceptions for bad files and failed downloads, and the messages of other errors."""

from __future__ import annotations

import os
from functools import partial
from typing import Any


def shown(name: object, keep: str = "") -> str:
    """Return a file's name, or any other text, on one line that a terminal can show safely.

    Line breaks, other control characters, invisible characters, characters that change the direction of writing, and
    bytes that aren't UTF-8 are escaped.

    Args:
        name: the text.
        keep: characters that are not escaped.
    """
    text = os.fspath(name) if isinstance(name, os.PathLike) else str(name)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else repr(c)[1:-1] for c in text)


class FormatError(ValueError):
    """A file that cannot be read as events.

    A DataLoader raises a worker's error again with the worker's traceback as the only argument. Then `reason` is the
    traceback, whose last line names the file, and `path` is empty.

    Args:
        path: the file.
        reason: why it can't be read.
        offset: byte of the file at which reading failed; None if the error isn't at a single byte.

    Example:
        >>> import tempfile, nvsdata
        >>> path = tempfile.mkstemp(suffix=".aedat4")[1]
        >>> try:
        ...     nvsdata.open(path)
        ... except nvsdata.FormatError as error:
        ...     print(error.reason)
        the extension means aedat4, but the file is empty
    """

    def __init__(self, path: str | os.PathLike[str], reason: str | None = None, *, offset: int | None = None) -> None:
        self.path, self.offset = "" if reason is None else os.fspath(path), offset
        self.reason = os.fspath(path) if reason is None else reason
        where = "" if offset is None else f" byte {offset}:"
        super().__init__(f"{shown(self.path)}:{where} {shown(self.reason)}" if self.path else self.reason)

    def __reduce__(self) -> tuple[Any, tuple[str, ...]]:
        # DataLoader workers send exceptions by pickle
        kind = partial(type(self), offset=self.offset)
        return kind, (self.path, self.reason) if self.path else (self.reason,)


def line_of(error: BaseException) -> str:
    """Return an error's message on one line of at most 300 characters."""
    return " ".join(str(error).split())[:300] or type(error).__name__


def message_of(error: BaseException) -> str:
    """Return an error's message in printable form, on one line.

    The message of a system error begins with its file and has no error number. A DownloadError's message keeps its line
    breaks.
    """
    if (text := str(error)).startswith("Caught "):
        # a DataLoader's worker sends its traceback, whose last line has the message
        return shown(text.rstrip().splitlines()[-1].partition(": ")[2])
    if isinstance(error, OSError) and error.errno is not None:
        names = [name for name in (error.filename, error.filename2) if name is not None]
        return shown(": ".join([*map(os.fsdecode, names), str(error.strerror)]))
    return shown(error, "\n" if isinstance(error, DownloadError) else "")


class DownloadError(OSError):
    """An archive that could not be downloaded or unpacked; the message says how to get it manually."""
