"""The one exception that bad files raise."""

from __future__ import annotations

import os


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
        super().__init__(f"{self.path}:{where} {self.reason}" if self.path else self.reason)

    def __reduce__(self) -> tuple[type, tuple[str, int | None, str] | tuple[str]]:
        # DataLoader workers send exceptions by pickle
        return type(self), (self.path, self.offset, self.reason) if self.path else (self.reason,)
