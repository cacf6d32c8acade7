"""Tables and HTML from text that may contain any characters, and names without their spelling."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence

from nvsdata.common.errors import shown


def aligned(rows: Sequence[Sequence[str]], *, left: bool = False) -> str:
    """Return a table of printable text whose columns are aligned.

    Args:
        rows: the cells of each row.
        left: whether columns are aligned to the left instead of to the right.
    """
    rows = [[*map(shown, row)] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    side = str.ljust if left else str.rjust
    return "\n".join("  ".join(map(side, row, widths)).rstrip() for row in rows)


def as_html(text: object, keep: str = "") -> str:
    """Return text for an HTML page, inside an element or a quoted attribute.

    Args:
        text: any text; characters that terminals can't show safely are escaped, too (see `shown`).
        keep: characters that are not escaped, such as line breaks.
    """
    return html.escape(shown(text, keep))


def as_script(value: object) -> str:
    """Return numbers, strings, lists and dicts as JSON for a script element of an HTML page.

    No string in it can end the element.
    """
    return json.dumps(value).replace("<", "\\u003c")


def plain_name(name: str) -> str:
    """Return a name in lower case without spaces and punctuation, so that spellings of it compare equal."""
    return "".join(c for c in name.lower() if c.isalnum())
