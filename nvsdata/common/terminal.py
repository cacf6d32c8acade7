"""Messages to the user, also after the terminal was closed."""

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

    def __eq__(self, other: object) -> bool:
        # tqdm asks which bars are on the stream that a line is written to
        return isinstance(other, Terminal) and self.stream is other.stream

    __hash__ = None  # type: ignore[assignment]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


class Escaped:
    """A text stream that escapes what a terminal could take for a command, see `shown`; lines and tabs stay."""

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
    """While the block runs, all that Python prints is escaped: by `print`, argparse, warnings, logs and libraries."""
    with (
        redirect_stdout(cast(TextIO, Escaped(unescaped(sys.stdout)))),
        redirect_stderr(cast(TextIO, Escaped(unescaped(sys.stderr)))),
    ):
        yield


def unescaped(stream: TextIO) -> TextIO:
    """The stream below one that escapes, for what moves the cursor on purpose."""
    return stream.stream if isinstance(stream, Escaped) else stream


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
