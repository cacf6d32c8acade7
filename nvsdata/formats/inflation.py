"""How far compressed data may expand: a few kB that claim gigabytes are damage, or an attack."""

from __future__ import annotations

ALWAYS = 1 << 26  # bytes that any file may expand to
RATIO = 100  # times its size that a larger file may expand to; events compress to a third or a tenth


def most_bytes(size: int) -> int:
    """The most bytes that a compressed file of `size` bytes is allowed to hold."""
    return max(ALWAYS, RATIO * size)
