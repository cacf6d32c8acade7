"""Progress bars on stderr, if it is a terminal and the user didn't turn them off."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from typing import Any

from tqdm import tqdm

from nvsdata.common.errors import shown as printable
from nvsdata.common.terminal import Terminal, is_quiet, unescaped


class Bar(tqdm):  # type: ignore[misc]
    """A progress bar that shows printable text only."""

    @property
    def format_dict(self) -> dict[str, Any]:
        found: dict[str, Any] = super().format_dict
        return found | {name: printable(found[name]) for name in ("prefix", "postfix") if found[name]}


WIDTH = 80  # columns of a terminal that doesn't report them


def bar(things: Iterable[Any] | None = None, desc: str | None = None, *, shown: bool = True, **more: Any) -> Any:
    """Return a progress bar.

    Args:
        things: iterable whose progress it shows; None for a bar that is advanced by its method `update`.
        desc: text in front of the bar.
        shown: False hides it.
        **more: parameters of tqdm.
    """
    if (columns := _columns()) is not None:
        # a pseudo-terminal may have no size: tqdm would draw nothing
        more = {"ncols": columns or WIDTH} | more
    # unescaped, because the bar moves the cursor
    more |= {"file": Terminal(unescaped(sys.stderr)), "disable": None if shown and not is_quiet() else True}
    return Bar(things, desc, **more)


def _columns() -> int | None:
    """Return the width that the terminal reports; None without a terminal."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError, AttributeError):
        return None


def say_above_bar(text: str) -> None:
    """Write a line to stderr, above any progress bar."""
    tqdm.write(printable(text), file=Terminal(unescaped(sys.stderr)))
