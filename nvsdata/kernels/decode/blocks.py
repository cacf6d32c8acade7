"""Records of a packed store: head, table of blocks, and blocks of events (docs/dev/store.md)."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

DAMAGES = (
    "a recording is cut short",
    "the head of a recording fails its checksum",
    "the head of a recording contradicts itself",
)
FAULTS = (
    "its events fail their checksum",
    "coordinates outside the sensor, or polarities other than 0 and 1",
    "events out of order",
    "its table has other times than its events",
)


def crc32c(raw: np.ndarray) -> int:
    """Return the CRC-32C (RFC 3720) of bytes, uint8 [N]."""
    value: int = _native.crc32c(raw)
    return value


def record_head(raw: np.ndarray, room: int) -> tuple[int, ...]:
    """Verify head and table of a record.

    Args:
        raw: First bytes of the record, uint8, with head and table.
        room: Bytes of the record.

    Returns:
        0 or 1 + the index in `DAMAGES` of what is wrong; then the number of blocks; time of the first event, duration,
        stated beginning and end in µs; width and height of the sensor; bytes of a time and of a coordinate; 1 if the
        blocks are compressed, otherwise 0.
    """
    found: tuple[int, ...] = _native.record_head(raw, room)
    return found


def blocks_between(table: np.ndarray, base: int, start: int, stop: int) -> tuple[int, int, int, int, int]:
    """Find the blocks that may have events with start <= t + base < stop. O(blocks).

    Args:
        table: Table of the blocks, uint8 [24 N].
        base: Time in µs that is added to stored times.
        start: First time of the window in µs.
        stop: End of the window in µs, excluded.

    Returns:
        The first block, the one after the last one, the first byte and the end of their bytes after the table, and the
        number of their events.
    """
    found: tuple[int, int, int, int, int] = _native.blocks_between(table, base, start, stop)
    return found


def unpack_blocks(
    out_t: np.ndarray,
    out_x: np.ndarray,
    out_y: np.ndarray,
    out_p: np.ndarray,
    base: int,
    start: int,
    stop: int,
    raw: np.ndarray,
    table: np.ndarray,
    check: bool,
    t_width: int,
    xy_width: int,
    width: int,
    height: int,
) -> tuple[int, int]:
    """Verify blocks, and copy their events with start <= t + base < stop. O(bytes).

    Args:
        out_t: Output for times in µs, int64, at least as long as all events of the blocks.
        out_x: Output for columns, int16.
        out_y: Output for rows, int16.
        out_p: Output for polarities, uint8.
        base: Time in µs that is added to stored times.
        start: First time of the window in µs.
        stop: End of the window in µs, excluded.
        raw: The blocks, one after the other, uint8: of each block the times, x, y and polarities.
        table: Table of these blocks, uint8 [24 N].
        check: True to verify the checksum of each block.
        t_width: Bytes of a stored time: 4 for uint32, 8 for int64.
        xy_width: Bytes of a stored coordinate: 1 for uint8, 2 for uint16.
        width: Width of the sensor in pixels.
        height: Height of the sensor in pixels.

    Returns:
        Number of events in the window, and 0 or, for a fault of block k, 4 k + 1 + its index in `FAULTS`.
    """
    found: tuple[int, int] = _native.unpack_blocks(
        out_t, out_x, out_y, out_p, base, start, stop, raw, table, int(check), t_width, xy_width, width, height
    )
    return found
