"""Pixels behind a photoreceptor of first order, whose bandwidth rises with the light: see `nvsdata.emulation.DVS`.

Light is a line from frame to frame, in steps of which each pixel has a rate of its own. Within a step a pixel is at
q(t) = base + slope t - lag exp(-rate t) above its memory, which turns once at most: so crossings are found on the
curve itself, and a tile whose light stays sleeps until one of its pixels reaches a threshold.
"""

from __future__ import annotations

import math

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.crossings import NEVER, rouse, row_of_levels
from nvsdata.kernels.spikes import grown
from nvsdata.kernels.tiles import TILE, find_dirty

CHANGE = 0.1  # of the logarithm of light, in a step of a pixel
CLOSE = 0.01  # µs to which a crossing is found
TRIES = 60  # after which halving alone has found it
EARLY = 1.0  # µs by which tiles wake early, because times are known to rounding only
TINY = 1e-12  # of the logarithm of light: a lag that doesn't turn a curve, and what rounding may add up to


@njit
def rate(level, sensor):
    """How fast photoreceptors approach a level of light, or levels, in 1/µs: v2e's (I + 20) / 275 of that at white."""
    return sensor.speed * (np.exp(level) - sensor.dark / 1000 + 20) / 275


@njit
def advance_receptors(frame, previous, first_weight, given, sensor, array, before, now, keys):
    """`crossings.advance` where pixels have photoreceptors."""
    height, width = array.level.shape
    find_dirty(frame, previous, frame.shape[1] // width * TILE[1], array.dirty)
    n = np.int64(0)
    end, scratch = np.empty_like(array.level[0]), np.empty((3, width), np.uint32)
    active = np.empty(array.dirty.shape[1], np.bool_)
    for r in range(array.dirty.shape[0]):
        dirty, since = array.dirty[r], array.since[r]
        if not rouse(dirty, array.wake[r], now, active):
            continue
        for y in range(r * TILE[0], min((r + 1) * TILE[0], height)):
            level = array.level[y]
            row_of_levels(frame, y, first_weight, given, sensor.table, sensor.dark, level, dirty, active, scratch, end)
            keys, n = _follow(end, y, active, sensor, array, before, now, keys, n)
        for c in range(active.size):
            since[c] = now if dirty[c] else since[c]
    return keys, n


@njit
def _follow(end, y, active, sensor, array, before, now, keys, n):
    """Events of a row's photoreceptors while the light goes to `end` in tiles that changed; the state follows.

    Returns the keys of the events, µs after `before`, and their number. O(active pixels + events).
    """
    level, memory, reached, speed = array.level[y], array.memory[y], array.reached[y], array.speed[y]
    dirty, wake, since = array.dirty[y // TILE[0]], array.wake[y // TILE[0]], array.since[y // TILE[0]]
    for tile in range(active.size):
        if not active[tile]:
            continue
        for i in range(tile * TILE[1], min((tile + 1) * TILE[1], end.size)):
            origin = since[tile]
            off = sensor.each[0, y, i] if sensor.each.size else sensor.thresholds[0]
            on = sensor.each[1, y, i] if sensor.each.size else sensor.thresholds[1]
            low, pixel = np.uint32(y << 17 | i << 1), (off, on, sensor.leak)
            lag = level[i] - reached[i]
            if not dirty[tile]:
                if lag != 0 or sensor.leak:
                    curve = (level[i] - memory[i] + sensor.leak * origin, sensor.leak, lag, speed[i])
                    part = np.float64(before - origin), np.float64(now - origin)
                    memory[i], keys, n = _fire(curve, part, part[0], pixel, memory[i], low, keys, n)
            else:
                if lag != 0:
                    lag *= math.exp(-speed[i] * (before - origin))
                lag, memory[i], keys, n = _along(
                    level[i], end[i], lag, speed[i], before, now, sensor, pixel, memory[i], low, keys, n
                )
                speed[i] = rate(end[i], sensor) if end[i] != level[i] else speed[i]
                level[i], reached[i], origin = end[i], end[i] - lag, now
            if wake[tile] > now:
                lag = level[i] - reached[i]
                wake[tile] = min(wake[tile], _next(level[i] - memory[i], lag, speed[i], origin, now, pixel))
    return keys, n


@njit
def _along(a, b, lag, speed, before, now, sensor, pixel, memory, low, keys, n):
    """The lag behind the light, the memory and the keys after the light of a pixel has gone from `a` to `b`."""
    off, on, leak = pixel
    if a == b:
        if lag != 0 or leak:
            curve = (a - memory + leak * before, leak, lag, speed)
            memory, keys, n = _fire(curve, (0.0, np.float64(now - before)), 0.0, pixel, memory, low, keys, n)
        return lag * math.exp(-speed * (now - before)), memory, keys, n
    steps = math.ceil(abs(b - a) / CHANGE)
    change, span = (b - a) / steps, (now - before) / steps
    grows, bright = math.exp(change), math.exp(a)
    for k in range(steps):
        # the mean of the rate along the step
        speed = sensor.speed * (bright * (grows - 1) / change - sensor.dark / 1000 + 20) / 275
        bright *= grows
        light, behind = a + k * change, change / span / speed
        since = before + k * span
        # what it follows, it doesn't overtake
        highest, lowest = max(light - lag, light, light + change), min(light - lag, light, light + change)
        if highest - memory + leak * (since + span) >= on or lowest - memory + leak * since <= -off:
            curve = light - behind - memory + leak * since, change / span + leak, lag - behind, speed
            memory, keys, n = _fire(curve, (0.0, span), -k * span, pixel, memory, low, keys, n)
        lag = behind + (lag - behind) * math.exp(-speed * span)
    return lag, memory, keys, n


@njit
def _fire(curve, part, start, pixel, memory, low, keys, n):
    """The memory and the keys after a part of a curve, (from, to); keys count µs from its time `start`."""
    base, slope, lag, speed = curve
    begin, last = part
    # where the curve turns, if it does
    turn = -slope / (speed * lag) if abs(lag) > TINY else -1.0
    middle = last
    if 0 < turn < 1:
        middle = min(max(-math.log(turn) / speed, begin), last)
    a = base + slope * begin - lag * math.exp(-speed * begin)
    moved = 0.0
    for half in range(2):
        stop = middle if half == 0 else last
        if half == 1 and middle == last:
            break
        b = base + slope * stop - lag * math.exp(-speed * stop)
        up = b > a
        step = pixel[1] if up else -pixel[0]
        at = begin
        while (b - moved >= step) if up else (b - moved <= step):
            moved += step
            at = _crossing(base - moved, slope, lag, speed, at, stop)
            if n == keys.size:
                keys = grown(keys, n, 1)
            keys[n] = np.uint64(np.int64(max(at - start + 0.5, 0.0))) << np.uint64(32) | np.uint64(low | np.uint32(up))
            n += 1
        begin, a = stop, b
    return memory + moved, keys, n


@njit
def _crossing(base, slope, lag, speed, first, last):
    """When base + slope t - lag exp(-speed t), which has one direction from `first` to `last`, is 0."""
    sign = 1.0 if base + slope * last - lag * math.exp(-speed * last) > 0 else -1.0
    t = last
    for _ in range(TRIES):
        far = lag * math.exp(-speed * t)
        value = base + slope * t - far
        if value * sign > 0:
            last = t
        else:
            first = t
        steep = slope + speed * far
        # Newton's step, or half of what is left
        new = t - value / steep if steep != 0 else first - 1.0
        if not first <= new <= last:
            new = 0.5 * (first + last)
        if abs(new - t) < CLOSE:
            return new
        t = new
    return t


@njit
def _next(ahead, lag, speed, origin, now, pixel):
    """A time, µs, at which a pixel whose light stays doesn't fire before; `ahead`: the light, above its memory."""
    off, on, leak = pixel
    if leak:
        lag *= math.exp(-speed * (now - origin))
        highest, lowest = ahead + leak * now + max(-lag, 0.0), ahead + leak * now - max(lag, 0.0)
        if highest >= on or lowest <= -off:
            return now
        return now + np.int64(min(max((on - highest) / leak - EARLY, 0.0), 2.0**61))
    # on its way up, or down; rounding lets it arrive early
    room = (ahead - on if lag > 0 else -off - ahead) + TINY
    if room <= 0 or room >= abs(lag):
        return now if room >= abs(lag) else NEVER
    return origin + np.int64(min(max(math.log(abs(lag) / room) / speed - EARLY, 0.0), 2.0**61))
