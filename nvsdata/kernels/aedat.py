"""AEDAT records to event columns and back. See `kernels.decode.atis` for what a decoder returns."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.clock import LAST as LAST_TIME
from nvsdata.kernels.clock import MIXED, WRAP_US, begin, go_evenly, nearest, unwrap
from nvsdata.kernels.compiling import njit
from nvsdata.kernels.reading import pread

DVS128, DAVIS = 0, 1
PROBE = 4096  # records that are checked for records other than events

_U = np.uint64


@njit(inline="always")
def _swapped(word):
    """The word with its four bytes in the other order."""
    # numba widens a shift to 64 bits
    return np.uint32(
        word << np.uint32(24)
        | (word & np.uint32(0xFF00)) << np.uint32(8)
        | (word >> np.uint32(8)) & np.uint32(0xFF00)
        | word >> np.uint32(24)
    )


@njit(inline="always")
def _little_endian(raw, j):
    return (
        np.uint32(raw[j])
        | np.uint32(raw[j + 1]) << np.uint32(8)
        | np.uint32(raw[j + 2]) << np.uint32(16)
        | np.uint32(raw[j + 3]) << np.uint32(24)
    )


@njit
def aedat2_decode(raw, block, layout, chip_width, chip_height, width, height, state, kept, t, x, y, p):
    """Decode AEDAT 2 records. O(N).

    `state` is that of `kernels.decode.clock`, and `block` the number of records in a block. `layout` DVS128 or DAVIS
    says what the address bits mean; x and y are mirrored within the chip. Records that are not polarity events
    are left out.
    """
    words = raw.view(np.uint32)
    size = words.size // 2
    if size == 0:
        return 0, -1
    t, x, y, p = t[kept : kept + size], x[kept : kept + size], y[kept : kept + size], p[kept : kept + size]
    right, bottom = np.int32(chip_width - 1), np.int32(chip_height - 1)
    begun, ended = np.int64(_swapped(words[1])), np.int64(_swapped(words[2 * size - 1]))
    odd = np.int64(chip_width > width or chip_height > height or ended - begun >= WRAP_US // 2) + state[MIXED]
    begin(state, begun)
    offset = nearest(begun, state[LAST_TIME], 32) - begun
    done = 0
    # frames and the like appear early, so the fast loop is tried only if a file's first records were all events
    for end in (1, min(PROBE, size), size):
        if odd == 0 and done < end:
            some = words[2 * done : 2 * end]
            back = 2 * max(done - 1, 0)
            before = words[back : back + some.size]
            ts, xs, ys, ps = t[done:end], x[done:end], y[done:end], p[done:end]
            if layout == DVS128:
                odd = _dvs128_odd(some, before, offset, right, bottom, ts, xs, ys, ps)
            else:
                odd = _davis_odd(some, before, offset, right, bottom, ts, xs, ys, ps)
        done = end
    if odd == 0:
        go_evenly(state, t, block)
        return size, -1
    for i in range(np.uint64(size)):
        t[i] = _swapped(words[_U(2) * i + _U(1)])
    unwrap(state, t, block)
    bad = -1
    count = np.uint64(0)
    for i in range(np.uint64(size)):
        address = _swapped(words[_U(2) * i])
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
        t[count] = t[i]
        x[count] = column
        y[count] = row
        p[count] = polarity
        if polar and (column < 0 or row < 0 or column >= width or row >= height) and bad < 0:
            bad = np.int64(i)
        count += np.uint64(polar)
    state[MIXED] |= np.int64(count) < size
    return np.int64(count), bad


@njit
def _dvs128_odd(words, before, offset, right, bottom, t, x, y, p):
    """Decode DVS128 records as if all were events; returns how many are not, or step back in time.

    `before`: the words of the records before each.
    """
    odd = 0
    # no value is carried from one iteration to the next, or the loop would not be vectorized
    for i in range(_U(t.size)):
        address, time = _swapped(words[_U(2) * i]), _swapped(words[_U(2) * i + _U(1)])
        odd += ((address & np.uint32(0x80008000)) != 0) | (time < _swapped(before[_U(2) * i + _U(1)]))
        t[i] = np.int64(time) + offset
        x[i] = right - np.int32(address >> np.uint32(1) & np.uint32(0x7F))
        y[i] = bottom - np.int32(address >> np.uint32(8) & np.uint32(0x7F))
        p[i] = ~address & np.uint32(1)
    return odd


@njit
def _davis_odd(words, before, offset, right, bottom, t, x, y, p):
    """The same for DAVIS records; those outside the chip are counted, too."""
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


@njit
def aedat2_encode(t, x, y, p, layout, chip_width, chip_height):
    """AEDAT 2 bytes, eight per event. O(N)."""
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
NEAR = 512  # bytes that are read at a packet's beginning: enough for a small packet and the next one
DISORDER_US = 1_000  # µs by which an event may lie before its packet's first or after its last event
# Faults of a file of packets: torn, damaged, or cut while it was read
FINE, TORN, NONSENSE, CUT = 0, 1, 2, 3
# Columns of the index of packets: byte of the first event, number of events, µs to add to their times, first and last
# time, whether the header counts fewer valid events than events
FIRST_BYTE, NUMBER, ADDED, FIRST, LAST, SOME_INVALID = range(6)


@njit
def aedat3_packets(known, handle, size, start):
    """Walk the packet headers of a file of `size` bytes from byte `start` on. O(packets).

    `known` uint8: the file's first bytes; unless these are all, `handle` is the open file. Returns the index of
    polarity packets, int64 [M, 6], a fault code, and the byte of the faulty packet (the file's size if none).
    """
    packets = np.empty((16, 6), np.int64)
    count = 0
    at = start
    near = known
    begin = np.int64(0)  # where in the file `near` begins
    while at < size:
        if size - at < PACKET_HEADER:
            return packets[:count], TORN, at
        near, begin = _near(near, begin, handle, at, min(at + PACKET_HEADER + 8, size), size)
        if near.size == 0:
            return packets[:count], CUT, at
        j = at - begin
        kind = np.int64(_little_endian(near, j) & 0xFFFF)
        length, when = np.int64(_little_endian(near, j + 4)), np.int64(_little_endian(near, j + 8))
        overflow, number = np.int64(_little_endian(near, j + 12)), np.int64(_little_endian(near, j + 20))
        valid = np.int64(_little_endian(near, j + 24))
        if length == 0 or length >= 1 << 31 or number >= 1 << 31 or valid > number or overflow >= 1 << 31:
            return packets[:count], NONSENSE, at
        if kind == POLARITY_EVENT and (length != 8 or when != 4):
            return packets[:count], NONSENSE, at
        first = at + PACKET_HEADER
        # the complete events of a torn packet are kept
        whole = min(number, (size - first) // length)
        torn = whole < number
        number = whole
        if kind == POLARITY_EVENT and number:
            if count == len(packets):
                longer = np.empty((2 * count, 6), np.int64)
                for i, field in np.ndindex(packets.shape):
                    longer[i, field] = packets[i, field]
                packets = longer
            add = overflow << 31
            packets[count, FIRST_BYTE], packets[count, NUMBER], packets[count, ADDED] = first, number, add
            packets[count, FIRST] = add + np.int64(_little_endian(near, first + 4 - begin))
            last = first + 8 * number - 4
            # the next packet's header follows, and is read together with it
            near, begin = _near(near, begin, handle, last, last + 4, size)
            if near.size == 0:
                return packets[:count], CUT, last
            packets[count, LAST] = add + np.int64(_little_endian(near, last - begin))
            packets[count, SOME_INVALID] = valid < number
            count += 1
        at = first + number * length
        if torn:
            return packets[:count], TORN, at
    return packets[:count], FINE, at


@njit
def _near(near, begin, handle, at, end, size):
    """Bytes that include at..end, and where they begin: `near` (at `begin`) or new ones; empty if the file was cut."""
    if begin <= at and end <= begin + near.size:
        return near, begin
    fresh = np.empty(min(NEAR, size - at), np.uint8)
    if pread(handle, fresh.ctypes.data, fresh.size, at) != fresh.size:
        return fresh[:0], at
    return fresh, at


@njit
def aedat3_decode(raw, base, packets, width, height, kept, t, x, y, p):
    """Decode polarity packets of the index. O(events).

    `raw` uint8 holds the file from byte `base` to the end of these packets. Events that aren't marked valid are
    dropped if the packet's header counts them as invalid. Returns the number of events, the byte of the first
    one outside the sensor (-1: none), the number of events kept without the mark, and the first packet with events
    that don't lie between its first and last event (-1: none).
    """
    begin = kept
    unmarked = 0
    bad = strayed = np.int64(-1)
    right, bottom = (width, height) if width > 0 else (1 << 15, 1 << 15)
    for k in range(len(packets)):
        first, number, add, some_invalid = packets[k, 0], packets[k, 1], packets[k, 2], packets[k, 5]
        # of 31 bits; a packet's first or last event may itself be an invalid one
        early = np.uint32(max(packets[k, FIRST] - add - DISORDER_US, 0) if not some_invalid else 0)
        late = np.uint32(
            min(packets[k, LAST] - add + DISORDER_US, (1 << 31) - 1) if not some_invalid else (1 << 31) - 1
        )
        records = raw[first - base : first - base + 8 * number].view(np.uint32)
        end = kept + number
        if _packet_sound(records, add, right, bottom, early, late, t[kept:end], x[kept:end], y[kept:end], p[kept:end]):
            kept = end
            continue
        for i in range(number):
            data, time = records[2 * i], records[2 * i + 1]
            marked = data & np.uint32(1)
            if some_invalid and not marked:
                continue
            unmarked += 1 - marked
            column, row = np.int64(data >> np.uint32(17)), np.int64(data >> np.uint32(2) & np.uint32(0x7FFF))
            if (column >= right or row >= bottom) and bad < 0:
                bad = first + 8 * i
            t[kept] = add + np.int64(time)
            if (time < early or time > late) and strayed < 0:
                strayed = k
            x[kept] = column
            y[kept] = row
            p[kept] = data >> np.uint32(1) & np.uint32(1)
            kept += 1
    return kept - begin, bad, unmarked, strayed


@njit
def _packet_sound(records, add, right, bottom, early, late, t, x, y, p):
    """Decode a packet as if all its events were sound, without branches; returns whether they were."""
    odd = 0
    for i in range(np.uint64(t.size)):
        data, time = records[np.uint64(2) * i], records[np.uint64(2) * i + np.uint64(1)]
        column = np.int32(data >> np.uint32(17))
        row = np.int32(data >> np.uint32(2) & np.uint32(0x7FFF))
        t[i] = add + np.int64(time)
        odd += (column >= right) | (row >= bottom) | ((data & np.uint32(1)) == 0) | (time < early) | (time > late)
        x[i] = column
        y[i] = row
        p[i] = data >> np.uint32(1) & np.uint32(1)
    return odd == 0
