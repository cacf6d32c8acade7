"""From PIX2NVS's differences to events (thesis 3.2.2): as keys of 64 bits, sorted, unpacked, read out.

A key: µs since the last frame << 32 | y << 17 | x << 1 | ON. A frame's keys are in raster order until they are sorted.
"""

from __future__ import annotations

import math

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.random import STEP, random_bits
from nvsdata.kernels.tiles import TILE

INTERPOLATED, RANDOM, AT_ONCE = range(3)
FEW = 3  # events per position that are always written, even if they don't count

_U, _U32, _I32 = np.uint64, np.uint32, np.int32


# with Python's error model every division tests for zero, and isn't vectorized
@njit(error_model="numpy")
def fire(difference, top, active, threshold, most, span, timing, seed, keys, n):
    """Events where |difference| >= threshold, (3.6) and (3.8), as keys in raster order.

    `difference` [rows, W] begins at row `top` of the frame. Times are k span T / |d| for the k-th of a
    position (`INTERPOLATED`), random, or left at 0; `span` has one value, the µs between the frames.
    `keys` already holds `n` keys; returns the keys, in a larger array if necessary, and their number.
    O(active pixels + events).
    """
    height, width = difference.shape
    mask, x = row_of_marks(width), np.empty(width + 8, np.uint16)
    low, count = np.empty(width, np.uint32), np.empty(width, np.int32)
    first, second, third = np.empty(width, np.int32), np.empty(width, np.int32), np.empty(width, np.int32)
    ratio, step = np.empty(width, difference.dtype), np.empty(width, span.dtype)
    most, half = _I32(min(most, 0x7FFFFFFF)), span.dtype.type(0.5)
    for y in range(height):
        m = _fired(difference[y], active[y // TILE[0]], threshold, mask, x)
        if m == 0:
            continue
        # one loop per array, so that each is vectorized
        for j in range(_U(m)):
            ratio[j] = difference[y, _U(x[j])]
        for j in range(_U(m)):
            ratio[j] = ratio[j] / threshold
        row = _U32((top + y) << 17)
        for j in range(_U(m)):
            low[j] = row | _U32(x[j]) << _U32(1) | _U32(ratio[j] > 0)
        total = np.int64(FEW)
        for j in range(_U(m)):
            count[j] = min(_I32(abs(ratio[j])), most)
            total += count[j]
        if n + total > keys.size:
            keys = grown(keys, n, total)
        if timing == INTERPOLATED:
            for j in range(_U(m)):
                step[j] = span[0] / abs(ratio[j])
        end = _U(n)
        if timing == INTERPOLATED and most <= FEW:
            for j in range(_U(m)):
                time = step[j] + half
                first[j] = _I32(time)
                time += step[j]
                second[j] = _I32(time)
                time += step[j]
                third[j] = _I32(time)
            # all three are always written; the next position overwrites those that don't count
            for j in range(_U(m)):
                place = _U(low[j])
                keys[end] = _U(_U32(first[j])) << _U(32) | place
                keys[end + _U(1)] = _U(_U32(second[j])) << _U(32) | place
                keys[end + _U(2)] = _U(_U32(third[j])) << _U(32) | place
                end += _U(count[j])
        else:
            for j in range(_U(m)):
                place = _U(low[j])
                for k in range(count[j]):
                    time = _U(0)
                    if timing == INTERPOLATED:
                        time = _U(np.int64((k + 1) * step[j] + half))
                    elif timing == RANDOM:
                        time = _random(seed, (place << _U(16)) + _U(k)) % _U(span[0])
                    keys[end] = time << _U(32) | place
                    end += _U(1)
        n = np.int64(end)
    return keys, n


@njit
def _fired(difference, active, threshold, mask, x):
    """Write to `x` where a row's |difference| >= threshold in active tiles; returns how many. `mask`: scratch."""
    right = 0
    while right < active.size:
        left, start = right, _U(right * TILE[1])
        # neighboring tiles together
        while right < active.size and active[right] == active[left]:
            right += 1
        end = _U(min(right * TILE[1], difference.size))
        if active[left]:
            for i in range(start, end):
                mask[i] = abs(difference[i]) >= threshold
        else:
            mask[start:end] = 0
    return gathered(mask, x)


@njit
def row_of_marks(width):
    """An array for a mark per pixel of a row, up to a multiple of 8, zero."""
    return np.zeros((width + 7) // 8 * 8, np.uint8)


@njit
def gathered(mask, x):
    """Write to `x` where a `row_of_marks` is 1; returns how many."""
    m, words = _U(0), mask.view(np.uint64)
    for w in range(_U(words.size)):
        word = words[w]
        if word:
            # without branches, because which of the eight fire is unpredictable
            for i in range(_U(8)):
                x[m] = _U(8) * w + i
                m += (word >> (_U(8) * i)) & _U(1)
    return np.int64(m)


@njit
def grown(keys, n, more):
    """The first `n` keys in an array with room for `more`."""
    larger = np.empty(2 * keys.size + more, np.uint64)
    for i in range(n):
        larger[i] = keys[i]
    return larger


@njit
def _random(seed, place):
    """64 random bits that depend only on the two numbers."""
    return random_bits(seed + (place + _U(1)) * _U(STEP))


@njit
def read(keys, bits, start, t, x, y, p):
    """Unpack keys into columns of events; if `bits` > 0, sort them first by their times below 2^bits, in place."""
    if bits:
        # the column of times serves as scratch until it is written
        sort_keys(keys, t.view(np.uint64), bits)
    for i in range(_U(keys.size)):
        key = keys[i]
        t[i] = start + np.int64(key >> _U(32))
        x[i] = np.int16((key >> _U(1)) & _U(0xFFFF))
        y[i] = np.int16((key >> _U(17)) & _U(0x7FFF))
        p[i] = np.uint8(key & _U(1))


@njit
def sort_keys(keys, spare, bits):
    """Sort keys stably by their times below 2^bits, in two digits; `spare` is scratch. O(N + 2^(bits / 2))."""
    digit = _U((bits + 1) // 2)
    mask = (_U(1) << digit) - _U(1)
    minor, major = _U(32), _U(32) + digit
    minors, majors = np.zeros(mask + _U(1), np.uint32), np.zeros(mask + _U(1), np.uint32)
    for i in range(_U(keys.size)):
        minors[(keys[i] >> minor) & mask] += _U32(1)
        majors[(keys[i] >> major) & mask] += _U32(1)
    _spread(keys, spare, minor, mask, minors)
    _spread(spare, keys, major, mask, majors)


@njit
def _spread(keys, out, shift, mask, places):
    """Write keys to `out` in order of a digit; `places`: how often each value occurs, overwritten."""
    total = _U32(0)
    for d in range(places.size):
        total, places[d] = _U32(total + places[d]), total
    for i in range(_U(keys.size)):
        d = (keys[i] >> shift) & mask
        out[_U(places[d])] = keys[i]
        places[d] += _U32(1)


@njit
def read_out(t, x, y, width, ready, refractory, gap, busy, start):
    """Times at which events leave a sensor that reads out one per `gap` µs, and which of them do. O(N).

    The readout is occupied until `start` + `busy`; the new `busy` is returned. A pixel is blind while its
    event waits and for `refractory` µs after: `ready` int64 [H * W] has the time in µs at which it sees again.
    """
    out, kept = np.empty_like(t), np.zeros(t.size, np.bool_)
    for i in range(t.size):
        pixel = y[i] * np.int64(width) + x[i]
        if t[i] < ready[pixel]:
            continue
        free = max(float(t[i] - start), busy)
        busy = free + gap
        out[i] = start + np.int64(math.ceil(free))
        kept[i] = True
        ready[pixel] = max(out[i], t[i]) + refractory
    return out, kept, busy
