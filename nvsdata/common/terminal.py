"""Messages to the user: control characters are escaped, and a closed terminal causes no error."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from typing import Any, TextIO, cast

from nvsdata.common.errors import shown
from nvsdata.common.files import named


class Terminal:
    """A text stream for messages that ignores errors, such as those after the terminal was closed."""

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

    def __eq__(self, other: object) -> bool:
        # tqdm looks for the bars on the stream that a line is written to
        return isinstance(other, Terminal) and self.stream is other.stream

    __hash__ = None  # type: ignore[assignment]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


class Escaped:
    """A text stream that escapes control characters (see `shown`), except line breaks and tabs."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write the text, escaped."""
        self.stream.write(shown(text, "\n\t"))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write texts, escaped."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def escaped_output() -> Iterator[None]:
    """Escape the output of the block: of `print`, argparse, warnings, logs and libraries."""
    with (
        redirect_stdout(cast(TextIO, Escaped(unescaped(sys.stdout)))),
        redirect_stderr(cast(TextIO, Escaped(unescaped(sys.stderr)))),
    ):
        yield


def unescaped(stream: TextIO) -> TextIO:
    """Return the stream that an `Escaped` stream writes to, for output that moves the cursor on purpose."""
    return stream.stream if isinstance(stream, Escaped) else stream


_quiet = False


def be_quiet(quiet: bool = True) -> None:
    """Turn notes and progress bars off, or on again."""
    global _quiet
    _quiet = quiet


def is_quiet() -> bool:
    """Return whether notes and progress bars are turned off."""
    return _quiet


def say(text: str, stream: TextIO | None = None) -> None:
    """Write a line, to stderr by default."""
    print(text, file=Terminal(stream or sys.stderr), flush=True)


def remark(text: str) -> None:
    """Write a note on the progress to stderr, unless notes are turned off."""
    if not _quiet:
        say(text)


def tell(text: str, facts: Mapping[str, Any], *, as_json: bool) -> None:
    """Write a result to stdout: `text` or, if `as_json`, `facts` as a line of JSON (null for NaN and infinity)."""
    with named("standard output"):
        print(json.dumps(_plain(facts), default=str) if as_json else text, flush=True)


def _plain(value: Any) -> Any:
    """Convert a value to types that JSON has: arrays to lists, NaN and infinity to None."""
    if hasattr(value, "tolist"):
        # an array or a number of numpy
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value
