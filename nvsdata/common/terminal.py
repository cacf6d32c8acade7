"""Messages to the user, also after the terminal was closed."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, TextIO

from nvsdata.common.files import named


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


_quiet = False


def be_quiet(quiet: bool = True) -> None:
    """From now on leave out notes and progress bars, or show them again."""
    global _quiet
    _quiet = quiet


def is_quiet() -> bool:
    """Whether notes and progress bars are left out."""
    return _quiet


def say(text: str, stream: TextIO | None = None) -> None:
    """Write a line, to stderr by default."""
    print(text, file=Terminal(stream or sys.stderr), flush=True)


def remark(text: str) -> None:
    """Write a line on how it goes to stderr, unless the user wants it quiet."""
    if not _quiet:
        say(text)


def tell(text: str, facts: Mapping[str, Any], *, as_json: bool) -> None:
    """Write a result to stdout: as text, or its facts as a line of JSON (null for what isn't a number)."""
    with named("standard output"):
        print(json.dumps(_plain(facts), default=str) if as_json else text, flush=True)


def _plain(value: Any) -> Any:
    """As JSON can hold it, which has neither NaN nor infinity."""
    if hasattr(value, "tolist"):
        # of numpy
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value
