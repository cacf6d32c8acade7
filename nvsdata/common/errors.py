"""The exceptions for bad files and failed downloads, and the texts of other errors."""

from __future__ import annotations

import os
from functools import partial
from typing import Any


def shown(name: object, keep: str = "") -> str:
    """A file's name, or any other text, in printable form on one line, as terminals can show it safely.

    Escaped are line breaks, other control characters, marks that change the direction of writing or show nothing, and
    bytes that aren't UTF-8; except the characters in `keep`.
    """
    text = os.fspath(name) if isinstance(name, os.PathLike) else str(name)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else repr(c)[1:-1] for c in text)


class FormatError(ValueError):
    """A file that cannot be read as events.

    - `path`: the file, str
    - `offset`: byte of the file at which reading failed; None, the default, if the error has no single byte
    - `reason`: what is wrong, str

    A DataLoader raises its worker's error again from a single text, the worker's traceback, whose last line names the
    file: `reason` is that text then, and `path` is empty.
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
    """An error's message on one line, of at most 300 characters: other libraries' messages may have many lines."""
    return " ".join(str(error).split())[:300] or type(error).__name__


def message_of(error: BaseException) -> str:
    """An error's message in printable form, on one line; only a DownloadError's keeps its lines."""
    return shown(error, "\n" if isinstance(error, DownloadError) else "")


class DownloadError(OSError):
    """An archive that could not be downloaded or unpacked; the message says how to get it manually."""
