"""Progress bars on stderr: where it is a terminal, and unless the user wants it quiet."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from typing import Any

from tqdm import tqdm

from nvsdata.common.terminal import Terminal, is_quiet

WIDTH = 80  # columns of a terminal that doesn't report them


def bar(things: Iterable[Any] | None = None, desc: str | None = None, *, shown: bool = True, **more: Any) -> Any:
    """A progress bar over `things`, or of `total`; `desc` is done, and `more` is for tqdm. `shown=False` hides it."""
    if _columns() == 0:
        # a pseudo-terminal whose size nobody has set: tqdm would draw nothing
        more = {"ncols": WIDTH} | more
    return tqdm(things, desc, disable=None if shown and not is_quiet() else True, **more)


def _columns() -> int | None:
    """Width of the terminal, as it reports it; None without one."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError, AttributeError):
        return None


def say_beside(text: str) -> None:
    """Write a line to stderr, above any progress bar."""
    tqdm.write(text, file=Terminal(sys.stderr))
