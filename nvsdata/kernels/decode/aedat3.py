"""Conversion of packets of AEDAT 3 files to event columns."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

POLARITY_EVENT = 1  # type of packets
PACKET_HEADER = 28  # bytes
DISORDER_US = 1_000  # µs by which an event may be before the first or after the last event of its packet
# Faults of a file of packets: truncated, damaged, or truncated while it was read
FINE, TORN, NONSENSE, CUT = 0, 1, 2, 3
FULL = 4  # there are more packets than rows for them
# Columns of the index of packets: byte of the first event, number of events, µs to add to their times, first and last
# time, 1 if the header counts fewer valid events than events
FIRST_BYTE, NUMBER, ADDED, FIRST, LAST, SOME_INVALID = range(6)


def aedat3_packets(known: np.ndarray, handle: int, size: int, start: int) -> tuple[np.ndarray, int, int]:
    """Walk the packet headers of a file of `size` bytes from byte `start` on. O(packets).

    `known` uint8 has the first bytes of the file. If it isn't the entire file, `handle` is the open file. Returns the
    index of polarity packets, int64 [M, 6], a fault code, and the byte at which the faulty packet begins (the size of
    the file if there is none).
    """
    parts, room, at, fault = [], 64, start, FULL
    while fault == FULL:
        part = np.empty((room, 6), np.int64)
        count, fault, at = _native.aedat3_packets(known, handle, size, at, part)
        parts.append(part[:count])
        room *= 4
    return parts[0] if len(parts) == 1 else np.concatenate(parts), fault, at


def aedat3_decode(
    raw: np.ndarray,
    base: int,
    packets: np.ndarray,
    width: int,
    height: int,
    kept: int,
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> tuple[int, int, int, int]:
    """Decode polarity packets of the index. O(events).

    `raw` uint8 has the bytes of the file from byte `base` to the end of these packets. Events that aren't marked as
    valid are dropped if the packet's header counts them as invalid. Returns the number of events, the byte of the first
    event outside the sensor (-1: none), the number of events that were kept without the mark, and the first packet with
    events whose times aren't between those of its first and last event (-1: none).
    """
    found: tuple[int, int, int, int] = _native.aedat3_decode(raw, base, packets, width, height, kept, t, x, y, p)
    return found
