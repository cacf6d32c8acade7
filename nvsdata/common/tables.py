"""Text tables."""

from __future__ import annotations

from collections.abc import Sequence

from nvsdata.common.errors import shown


def aligned(rows: Sequence[Sequence[str]], *, left: bool = False) -> str:
    """Rows of texts in columns, aligned to the right, or to the left if `left`, in printable form."""
    rows = [[*map(shown, row)] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    side = str.ljust if left else str.rjust
    return "\n".join("  ".join(map(side, row, widths)).rstrip() for row in rows)
