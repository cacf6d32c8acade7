"""The one exception that bad files raise."""

from __future__ import annotations

import os


class FormatError(ValueError):
    """A file that cannot be read as events.

    Attributes: `path` (str), `offset` (byte in the file where reading failed, or None when no
    single byte is to blame) and `reason`.
    """

    def __init__(self, path: str | os.PathLike[str], offset: int | None, reason: str) -> None:
        self.path = os.fspath(path)
        self.offset = offset
        self.reason = reason
        where = "" if offset is None else f" byte {offset}:"
        super().__init__(f"{self.path}:{where} {reason}")

    def __reduce__(self) -> tuple[type, tuple[str, int | None, str]]:
        # DataLoader workers send exceptions by pickle
        return FormatError, (self.path, self.offset, self.reason)
