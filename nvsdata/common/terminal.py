"""Messages to the user, also after the terminal was closed."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import Any, TextIO


class Terminal:
    """A text stream for messages; after its terminal was closed, writing is ignored without an error."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write the text; errors of the stream are ignored."""
        with suppress(OSError):
            self.stream.write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            self.stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def say(text: str, stream: TextIO | None = None) -> None:
    """Write a line, to stderr by default."""
    print(text, file=Terminal(stream or sys.stderr), flush=True)
