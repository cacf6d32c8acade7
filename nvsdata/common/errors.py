"""The exceptions that bad files and failed downloads raise, and what others say."""

from __future__ import annotations

import os


def shown(name: str | os.PathLike[str]) -> str:
    """A file's name as it can be printed, on one line: line breaks and bytes that aren't UTF-8 are escaped."""
    text = os.fspath(name)
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


class FormatError(ValueError):
    """A file that cannot be read as events.

    Attributes: `path` (str), `offset` (byte in the file where reading failed, or None when no
    single byte is to blame) and `reason`.

    A DataLoader makes what its worker raised anew from one text, the worker's traceback, whose last line
    names the file: that is `reason` then, and `path` is empty.
    """

    def __init__(self, path: str | os.PathLike[str], offset: int | None = None, reason: str | None = None) -> None:
        self.path, self.offset = "" if reason is None else os.fspath(path), offset
        self.reason = os.fspath(path) if reason is None else reason
        where = "" if offset is None else f" byte {offset}:"
        super().__init__(f"{shown(self.path)}:{where} {self.reason}" if self.path else self.reason)

    def __reduce__(self) -> tuple[type, tuple[str, int | None, str] | tuple[str]]:
        # DataLoader workers send exceptions by pickle
        return type(self), (self.path, self.offset, self.reason) if self.path else (self.reason,)


def line_of(error: BaseException) -> str:
    """What an error says, in a line: of other libraries' errors, which may have many."""
    return " ".join(str(error).split())[:300] or type(error).__name__


class DownloadError(OSError):
    """An archive that could not be downloaded or unpacked; the text says how to get it by hand."""
