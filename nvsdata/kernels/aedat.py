"""AEDAT records to event columns and back. See `kernels.decode` for what a decoder returns."""

from __future__ import annotations

import numpy as np
from numba import njit

from nvsdata.kernels.decode import IN_ORDER, WRAP_US

DVS128, DAVIS = 0, 1
PROBE = 4096  # records that tell whether a file has others than events

_U = np.uint64


@njit(cache=True, nogil=True, inline="always")
def _swapped(word):
    """The word with its four bytes in the other order."""
    # numba makes 64 bits of a shift
    return np.uint32(
        word << np.uint32(24)
        | (word & np.uint32(0xFF00)) << np.uint32(8)
        | (word >> np.uint32(8)) & np.uint32(0xFF00)
        | word >> np.uint32(24)
    )


@njit(cache=True, nogil=True, inline="always")
def _little_endian(raw, j):
    return (
        np.uint32(raw[j])
        | np.uint32(raw[j + 1]) << np.uint32(8)
        | np.uint32(raw[j + 2]) << np.uint32(16)
        | np.uint32(raw[j + 3]) << np.uint32(24)
    )


@njit(cache=True, nogil=True)
def aedat2_decode(words, lo, hi, offset, layout, chip_width, chip_height, width, height, t, x, y, p):
    """Decode AEDAT 2 records lo..hi, `offset` µs of wraps in force at `lo`. O(hi - lo).

    `words` uint32 [2 N]: address and time in turns, as they lie in the file (big-endian). `layout` DVS128
    or DAVIS says what the address bits mean; x and y are mirrored within the chip. Records that are
    no polarity events are left out. Times are unsigned and wrap at 2^32.
    """
    room = hi - lo
    right, bottom = np.int32(chip_width - 1), np.int32(chip_height - 1)
    odd = np.int64(chip_width > width or chip_height > height)
    begin = 0
    # frames and the like show early: so the most of a file is begun only where its first records were events
    for end in (min(1, room), min(PROBE, room), room):
        if odd == 0 and begin < end:
            some = words[2 * (lo + begin) : 2 * (lo + end)]
            back = 2 * (lo + max(begin - 1, 0))
            before = words[back : back + some.size]
            ts, xs, ys, ps = t[begin:end], x[begin:end], y[begin:end], p[begin:end]
            if layout == DVS128:
                odd = _dvs128_odd(some, before, offset, right, bottom, ts, xs, ys, ps)
            else:
                odd = _davis_odd(some, before, offset, right, bottom, ts, xs, ys, ps)
        begin = end
    if odd == 0:
        return room, IN_ORDER
    bad = -1
    kept = np.uint64(0)
    last = np.int64(0)
    for i in range(np.uint64(room)):
        k = _U(2) * (_U(lo) + i)
        address, time = _swapped(words[k]), np.int64(_swapped(words[k + _U(1)]))
        if last - time > WRAP_US // 2:
            offset += WRAP_US
        last = time
        if layout == DVS128:
            column = chip_width - 1 - np.int32(address >> np.uint32(1) & np.uint32(0x7F))
            row = chip_height - 1 - np.int32(address >> np.uint32(8) & np.uint32(0x7F))
            polarity = ~address & np.uint32(1)
            polar = (address & np.uint32(0x80008000)) == 0
        else:
            column = chip_width - 1 - np.int32(address >> np.uint32(12) & np.uint32(0x3FF))
            row = chip_height - 1 - np.int32(address >> np.uint32(22) & np.uint32(0x1FF))
            polarity = address >> np.uint32(11) & np.uint32(1)
            polar = (address & np.uint32(0x80000400)) == 0
        t[kept] = time + offset
        x[kept] = column
        y[kept] = row
        p[kept] = polarity
        if polar and (column < 0 or row < 0 or column >= width or row >= height) and bad < 0:
            bad = lo + np.int64(i)
        kept += np.uint64(polar)
    return np.int64(kept), bad


@njit(cache=True, nogil=True)
def _dvs128_odd(words, before, offset, right, bottom, t, x, y, p):
    """Decode DVS128 records as if all were events; how many are not, or step back from those `before` them."""
    odd = 0
    # no value is carried from turn to turn, or the loop would not be vectorised
    for i in range(_U(t.size)):
        address, time = _swapped(words[_U(2) * i]), _swapped(words[_U(2) * i + _U(1)])
        odd += ((address & np.uint32(0x80008000)) != 0) | (time < _swapped(before[_U(2) * i + _U(1)]))
        t[i] = np.int64(time) + offset
        x[i] = right - np.int32(address >> np.uint32(1) & np.uint32(0x7F))
        y[i] = bottom - np.int32(address >> np.uint32(8) & np.uint32(0x7F))
        p[i] = ~address & np.uint32(1)
    return odd


@njit(cache=True, nogil=True)
def _davis_odd(words, before, offset, right, bottom, t, x, y, p):
    """The same of DAVIS records; those beyond the chip count as odd, too."""
    odd = 0
    for i in range(_U(t.size)):
        address, time = _swapped(words[_U(2) * i]), _swapped(words[_U(2) * i + _U(1)])
        column = right - np.int32(address >> np.uint32(12) & np.uint32(0x3FF))
        row = bottom - np.int32(address >> np.uint32(22) & np.uint32(0x1FF))
        strange = (address & np.uint32(0x80000400)) != 0
        odd += strange | (column < 0) | (row < 0) | (time < _swapped(before[_U(2) * i + _U(1)]))
        t[i] = np.int64(time) + offset
        x[i] = column
        y[i] = row
        p[i] = address >> np.uint32(11) & np.uint32(1)
    return odd


@njit(cache=True, nogil=True)
def aedat2_encode(t, x, y, p, layout, chip_width, chip_height):
    """AEDAT 2 bytes, eight an event. O(N)."""
    raw = np.empty((t.size, 8), np.uint8)
    for i in range(t.size):
        column, row = np.uint32(chip_width - 1 - x[i]), np.uint32(chip_height - 1 - y[i])
        if layout == DVS128:
            address = row << 8 | column << 1 | np.uint32(1 - p[i])
        else:
            address = row << 22 | column << 12 | np.uint32(p[i]) << 11
        time = t[i] % WRAP_US
        for byte in range(4):
            raw[i, byte] = address >> (24 - 8 * byte) & 0xFF
            raw[i, 4 + byte] = time >> (24 - 8 * byte) & 0xFF
    return raw


POLARITY_EVENT = 1
PACKET_HEADER = 28
# What can be wrong with a packet
FINE, TORN, NONSENSE = 0, 1, 2


@njit(cache=True, nogil=True)
def aedat3_packets(raw, start):
    """Walk the packet headers from byte `start`. O(packets).

    Returns int64 [M, 6] for polarity packets: byte of the first event, number of events, µs to add
    to their times, first and last time, whether the header counts fewer valid events than events;
    then a fault code and the byte of the packet that has it (the file's size if none).
    """
    packets = np.empty((16, 6), np.int64)
    count = 0
    at = start
    while at < raw.size:
        if raw.size - at < PACKET_HEADER:
            return packets[:count], TORN, at
        kind = np.int64(_little_endian(raw, at) & 0xFFFF)
        size, when = np.int64(_little_endian(raw, at + 4)), np.int64(_little_endian(raw, at + 8))
        overflow, number = np.int64(_little_endian(raw, at + 12)), np.int64(_little_endian(raw, at + 20))
        valid = np.int64(_little_endian(raw, at + 24))
        if size == 0 or size >= 1 << 31 or number >= 1 << 31 or valid > number or overflow >= 1 << 31:
            return packets[:count], NONSENSE, at
        if kind == POLARITY_EVENT and (size != 8 or when != 4):
            return packets[:count], NONSENSE, at
        first = at + PACKET_HEADER
        # of a torn packet the whole events are kept
        whole = min(number, (raw.size - first) // size)
        torn = whole < number
        number = whole
        if kind == POLARITY_EVENT and number:
            if count == len(packets):
                longer = np.empty((2 * count, 6), np.int64)
                for i, field in np.ndindex(packets.shape):
                    longer[i, field] = packets[i, field]
                packets = longer
            add = overflow << 31
            packets[count, 0], packets[count, 1], packets[count, 2] = first, number, add
            packets[count, 3] = add + np.int64(_little_endian(raw, first + 4))
            packets[count, 4] = add + np.int64(_little_endian(raw, first + 8 * number - 4))
            packets[count, 5] = valid < number
            count += 1
        at = first + number * size
        if torn:
            return packets[:count], TORN, at
    return packets[:count], FINE, at


@njit(cache=True, nogil=True)
def aedat3_decode(words, phase, starts, packets, width, height, t, x, y, p):
    """Decode polarity packets as `aedat3_packets` lists them. O(events).

    `words` uint32 hold the events of packet k from byte `starts[k]` on, counted from `phase` bytes
    before them.
    Events that aren't marked valid are dropped where the packet's header counts them as invalid.
    Returns the number of events, the byte of the first one outside the sensor (-1: none), and how many
    were kept without the mark.
    """
    kept = unmarked = 0
    bad = np.int64(-1)
    right, bottom = (width, height) if width > 0 else (1 << 15, 1 << 15)
    for k in range(len(packets)):
        first, number, add, some_invalid = packets[k, 0], packets[k, 1], packets[k, 2], packets[k, 5]
        at = (starts[k] - phase) // 4
        records = words[at : at + 2 * number]
        end = kept + number
        if _packet_sound(records, add, right, bottom, t[kept:end], x[kept:end], y[kept:end], p[kept:end]):
            kept = end
            continue
        for i in range(number):
            data = records[2 * i]
            marked = data & np.uint32(1)
            if some_invalid and not marked:
                continue
            unmarked += 1 - marked
            column, row = np.int64(data >> np.uint32(17)), np.int64(data >> np.uint32(2) & np.uint32(0x7FFF))
            if (column >= right or row >= bottom) and bad < 0:
                bad = first + 8 * i
            t[kept] = add + np.int64(records[2 * i + 1])
            x[kept] = column
            y[kept] = row
            p[kept] = data >> np.uint32(1) & np.uint32(1)
            kept += 1
    return kept, bad, unmarked


@njit(cache=True, nogil=True)
def _packet_sound(records, add, right, bottom, t, x, y, p):
    """Decode a packet as if all its events were valid and within the sensor, without branches; whether it was so."""
    odd = 0
    for i in range(np.uint64(t.size)):
        data, time = records[np.uint64(2) * i], records[np.uint64(2) * i + np.uint64(1)]
        column = np.int32(data >> np.uint32(17))
        row = np.int32(data >> np.uint32(2) & np.uint32(0x7FFF))
        odd += (column >= right) | (row >= bottom) | ((data & np.uint32(1)) == 0)
        t[i] = add + np.int64(time)
        x[i] = column
        y[i] = row
        p[i] = data >> np.uint32(1) & np.uint32(1)
    return odd == 0
