"""Text tables."""

from __future__ import annotations

from collections.abc import Sequence


def aligned(rows: Sequence[Sequence[str]], *, left: bool = False) -> str:
    """Rows of texts in columns, aligned to the right, or to the left if `left`."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    side = str.ljust if left else str.rjust
    return "\n".join("  ".join(map(side, row, widths)).rstrip() for row in rows)
