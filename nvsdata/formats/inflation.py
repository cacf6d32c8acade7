"""How much a compressed file may come to: a few kB that claim gigabytes are damage, or meant to harm."""

from __future__ import annotations

ALWAYS = 1 << 26  # bytes that any file may come to
RATIO = 100  # times its size; events compress to a third or a tenth


def most_bytes(size: int) -> int:
    """Bytes that a compressed file of `size` bytes is taken to hold at most."""
    return max(ALWAYS, RATIO * size)
