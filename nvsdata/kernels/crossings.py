"""A pixel that compares with the level at its last event, one frame at a time: see `nvsdata.emulation.DVS`.

Arrays: `level`, `memory`, `reached`, `speed` of one float type [H, W], the last two only with a photoreceptor; frames
uint8 [H, W * C]. Between frames a level is a line, so a pixel crosses thresholds in one direction only, and where
neither light nor memory moves it doesn't cross any. So tiles that don't change are left out until their `wake`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.emulate import look_up, weigh
from nvsdata.kernels.logarithm import logarithm
from nvsdata.kernels.spikes import FEW, gathered, grown, row_of_marks
from nvsdata.kernels.tiles import TILE, find_dirty

NEVER = 2**62  # µs
SLACK = 2.0**-24  # share of a threshold by which tiles wake early, because sleeping pixels are known to rounding only
_U, _U32, _I32 = np.uint64, np.uint32, np.int32


class Sensor(NamedTuple):
    """What stays the same from frame to frame.

    - `table`: level by gray byte or by luminance in thousandths; empty to compute logarithms of colors
    - `dark`: thousandths of a gray level that are added to brightness before its logarithm
    - `thresholds` [2] of OFF and ON, and `each` [2, H, W] each pixel's own, or empty
    - `leak`: by how much memory falls per µs
    - `speed`: of a white pixel's photoreceptor, in 1/µs; 0 for one that follows at once
    """

    table: np.ndarray
    dark: int
    thresholds: np.ndarray
    each: np.ndarray
    leak: float
    speed: float


class Array(NamedTuple):
    """The state of all pixels, and of tiles [tile rows, tile columns].

    - `level`: logarithm of the light in the last frame
    - `memory`: level at the last event, as if it had been at time 0
    - `reached`: where photoreceptors were when their tile changed last, and `speed`: how fast they approach the level
    - `dirty` bool: tiles that changed; `wake` int64: when (µs) one may fire though it doesn't change
    - `since` int64: µs of its last change
    """

    level: np.ndarray
    memory: np.ndarray
    reached: np.ndarray
    speed: np.ndarray
    dirty: np.ndarray
    wake: np.ndarray
    since: np.ndarray


@njit
def advance(frame, previous, first_weight, given, sensor, array, before, now, span, keys):
    """Process a frame at `now` µs, the last one was at `before`; returns the keys of its events and their number.

    `given` [H, W] replaces the logarithm of the frame's bytes, unless it is empty. `span` has one value, the µs
    between the frames, in the type that times are calculated in.
    """
    height, width = array.level.shape
    find_dirty(frame, previous, frame.shape[1] // width * TILE[1], array.dirty)
    n = np.int64(0)
    end = np.empty_like(array.level[0])
    scratch = np.empty((3, width), np.uint32)
    number = array.level.dtype
    buffers = (
        row_of_marks(width),
        np.empty(width + 8, np.uint16),
        np.empty(width, number),
        np.empty(width, number),
        np.empty(width, number),
        np.empty(width, span.dtype),
        np.empty(width, span.dtype),
        np.empty(width, np.int32),
        np.empty(width, np.uint32),
        np.empty((FEW, width), np.int32),
    )
    active = np.empty(array.dirty.shape[1], np.bool_)
    # arrays one by one, because a tuple of them takes long to pass on
    levels, memories, each, thresholds, leak = array.level, array.memory, sensor.each, sensor.thresholds, sensor.leak
    table, dark, dirties, wakes = sensor.table, sensor.dark, array.dirty, array.wake
    for r in range(dirties.shape[0]):
        dirty, wake = dirties[r], wakes[r]
        if not rouse(dirty, wake, now, active):
            continue
        for y in range(r * TILE[0], min((r + 1) * TILE[0], height)):
            level, memory = levels[y], memories[y]
            row_of_levels(frame, y, first_weight, given, table, dark, level, dirty, active, scratch, end)
            fallen = memory.dtype.type(leak * before), memory.dtype.type(leak * now)
            keys, n = _cross(level, end, y, active, each, thresholds, memory, wake, fallen, now, span, buffers, keys, n)
            _keep(end, dirty, level)
            if leak:
                _set_wake(y, active, each, thresholds, level, memory, wake, leak, now)
    return keys, n


@njit
def rouse(dirty, wake, now, active):
    """Which tiles of a row changed, or wake at `now`; returns whether any does. They have no time to wake at then."""
    some = False
    for c in range(active.size):
        active[c] = dirty[c] or wake[c] <= now
        wake[c] = NEVER if active[c] else wake[c]
        some |= active[c]
    return some


@njit
def row_of_levels(frame, y, first_weight, given, table, dark, level, dirty, active, scratch, end):
    """Write the levels of the frame to `end`, in a row's active tiles; `scratch` uint32 [3, W]."""
    width, right = end.size, 0
    while right < active.size:
        # neighboring tiles together
        left = right
        while right < active.size and active[right] == active[left] and dirty[right] == dirty[left]:
            right += 1
        if not active[left]:
            continue
        x0, x1 = left * TILE[1], min(right * TILE[1], width)
        if not dirty[left]:
            end[x0:x1] = level[x0:x1]
        elif given.size:
            end[x0:x1] = given[y, x0:x1]
        else:
            light = frame[y, x0:x1] if frame.shape[1] == width else frame[y, 3 * x0 : 3 * x1]
            _logarithms(light, first_weight, table, dark, scratch, end[x0:x1])


@njit
def _keep(end, dirty, level):
    """`level` of a row = `end` in tiles that changed."""
    for tile in range(dirty.size):
        if dirty[tile]:
            for i in range(_U(tile * TILE[1]), _U(min((tile + 1) * TILE[1], end.size))):
                level[i] = end[i]


@njit
def _logarithms(light, first_weight, table, dark, scratch, out):
    """ln(q + dark) of a row of gray or color bytes."""
    if light.size == out.size:
        look_up(light, table, out)
        return
    thousandths = scratch[2, : out.size].view(np.int32)
    weigh(light, np.int32(first_weight), np.int32(413 - first_weight), thousandths)
    if table.size:
        look_up(thousandths, table, out)
        return
    for i in range(_U(out.size)):
        thousandths[i] += np.int32(dark)
    logarithm(thousandths, np.float32(0), np.float32(1), scratch, out)


@njit
def _fired(end, y, active, each, thresholds, memory, drift, mask, x):
    """Write to `x` where a row's pixels have reached their thresholds; returns how many. `mask`: scratch."""
    off, on, right = thresholds[0], thresholds[1], 0
    while right < active.size:
        left, first = right, _U(right * TILE[1])
        # neighboring tiles together
        while right < active.size and active[right] == active[left]:
            right += 1
        last = _U(min(right * TILE[1], end.size))
        if not active[left]:
            mask[first:last] = 0
        elif each.size:
            for i in range(first, last):
                d = end[i] - memory[i] + drift
                mask[i] = (d >= each[1, y, i]) | (-d >= each[0, y, i])
        else:
            for i in range(first, last):
                d = end[i] - memory[i] + drift
                mask[i] = (d >= on) | (-d >= off)
    return gathered(mask, x)


# with Python's error model every division tests for zero, and isn't vectorized
@njit(error_model="numpy")
def _cross(start, end, y, active, each, thresholds, memory, wake, fallen, now, span, buffers, keys, n):
    """Events of a row whose levels go from `start` to `end`, as keys; memories follow. O(active pixels + events)."""
    past, drift = fallen
    mask, x, moved, rise, step, first, later, count, low, three = buffers
    m = _fired(end, y, active, each, thresholds, memory, drift, mask, x)
    if m == 0:
        return keys, n
    off, on, zero = thresholds[0], thresholds[1], memory.dtype.type(0)
    # one loop per array, so that each is vectorized
    for j in range(_U(m)):
        place = _U(x[j])
        moved[j] = end[place] - memory[place] + drift
        rise[j] = start[place] - memory[place] + past
    if each.size:
        for j in range(_U(m)):
            step[j] = each[_U(moved[j] > zero), y, _U(x[j])]
    else:
        for j in range(_U(m)):
            step[j] = on if moved[j] > zero else off
    row, total = _U32(y << 17), np.int64(FEW)
    for j in range(_U(m)):
        count[j] = _I32(abs(moved[j]) / step[j])
        total += count[j]
        low[j] = row | _U32(x[j]) << _U32(1) | _U32(moved[j] > zero)
    for j in range(_U(m)):
        # rounding may leave a pixel at its threshold: it fires in the next frame, at once
        change = abs(moved[j] - rise[j])
        slope = span[0] / change if change > zero else span.dtype.type(0)
        later[j] = step[j] * slope
        first[j] = span[0] - (abs(moved[j]) - step[j]) * slope if change > zero else span.dtype.type(0)
    for j in range(_U(m)):
        place = _U(x[j])
        spent = step[j] * count[j]
        memory[place] += spent if moved[j] > zero else -spent
        if abs(moved[j]) - spent >= step[j]:
            wake[place // _U(TILE[1])] = now
    if n + total > keys.size:
        keys = grown(keys, n, total)
    return keys, _write(first, later, count, low, three, m, keys, n)


@njit
def _write(first, later, count, low, three, m, keys, n):
    """The keys of `count` events each, from `first` on every `later` µs; `three`: scratch."""
    end, zero, half = _U(n), first.dtype.type(0), first.dtype.type(0.5)
    for k in range(FEW):
        times = three[k]
        for j in range(_U(m)):
            times[j] = _I32(max(first[j] + _I32(k) * later[j] + half, zero))
    one, two, last = three[0], three[1], three[2]
    for j in range(_U(m)):
        place = _U(low[j])
        # all three are always written; the next pixel overwrites those that don't count
        keys[end] = _U(_U32(one[j])) << _U(32) | place
        keys[end + _U(1)] = _U(_U32(two[j])) << _U(32) | place
        keys[end + _U(2)] = _U(_U32(last[j])) << _U(32) | place
        for k in range(FEW, count[j]):
            keys[end + _U(k)] = _U(np.int64(max(first[j] + k * later[j] + half, zero))) << _U(32) | place
        end += _U(count[j])
    return np.int64(end)


@njit
def _set_wake(y, active, each, thresholds, level, memory, wake, leak, now):
    """Bring forward when tiles of a row wake, because memory leaks."""
    for i in range(level.size):
        tile = i // TILE[1]
        if not active[tile] or wake[tile] <= now:
            continue
        on = each[1, y, i] if each.size else thresholds[1]
        room = on * (1 - SLACK) - (level[i] + leak * now - memory[i])
        wake[tile] = now if room <= 0 else min(wake[tile], now + np.int64(min(room / leak, 2.0**61)))
