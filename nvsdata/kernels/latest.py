"""Images of what pixels last saw: latest times, and sums that leak."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit


@njit
def counts_and_times(t, x, y, p, start, duration, out):
    """Add events to `out` [4, H, W]: numbers of ON and OFF events, and their latest times as shares of `duration`."""
    for i in range(np.uint64(t.size)):
        channel, row, column = np.uint64(1 - p[i]), np.uint64(y[i]), np.uint64(x[i])
        out[channel, row, column] += np.float32(1)
        out[channel + np.uint64(2), row, column] = np.float64(t[i] - start) / duration


@njit
def leak_into(t, x, y, increment, leak, value, since):
    """Add `increment` to `value` for each event; values fall by `leak` per µs, not below 0. O(N).

    `value` float64 and `since` int64, both [H, W], are the state: values, and when they were so.
    """
    for i in range(np.uint64(t.size)):
        row, column = np.uint64(y[i]), np.uint64(x[i])
        left = value[row, column] - leak * np.float64(t[i] - since[row, column])
        value[row, column] = max(left, 0.0) + increment
        since[row, column] = t[i]


@njit
def remember(t, x, y, p, times, counts):
    """Put times into the rings `times` int64 [2, k, H, W], counted by `counts` int64 [2, H, W], ON first. O(N)."""
    k = times.shape[1]
    for i in range(np.uint64(t.size)):
        channel, row, column = np.uint64(1 - p[i]), np.uint64(y[i]), np.uint64(x[i])
        times[channel, np.uint64(counts[channel, row, column] % k), row, column] = t[i]
        counts[channel, row, column] += 1


@njit(inline="always")
def _logarithm(age, least, most):
    return min(max(np.log1p(np.float64(age)), least), most) - least


@njit
def logarithms(age, known, least, most):
    """`logarithms_of_ages` for ages int64 [N]: float32 [N], as of age `most` where they aren't `known`. O(N)."""
    out = np.full(age.size, np.float32(most - least))
    for i in range(age.size):
        if known[i]:
            out[i] = _logarithm(age[i], least, most)
    return out


@njit
def logarithms_of_ages(t, x, y, p, end, least, most, have, out):
    """Put log(age + 1), from `least` up to `most`, minus `least`, of pixels' latest events into `out` [2, k, H, W].

    Ages are those at `end`, ON and the latest event come first. `have` int32 [2, H, W] is scratch, 0. O(N).
    """
    k = out.shape[1]
    for after in range(t.size):
        i = np.uint64(t.size - 1 - after)
        channel, row, column = np.uint64(1 - p[i]), np.uint64(y[i]), np.uint64(x[i])
        slot = have[channel, row, column]
        if slot < k:
            out[channel, np.uint64(slot), row, column] = _logarithm(end - t[i], least, most)
            have[channel, row, column] = slot + 1


@njit
def queue_bins(t, x, y, p, origin, duration, bins, within, used):
    """Add times to queues of the latest bins of `duration` from `origin` on that have events, OFF first. O(N).

    `bins` int64 [2, H, W, K], and `within` float64 [2, H, W, K, 2], the sum of times from a bin's beginning and their
    number, are rings, in which `used` int64 [2, H, W] slots were ever begun.
    """
    depth = bins.shape[3]
    for i in range(np.uint64(t.size)):
        channel, row, column = np.uint64(p[i]), np.uint64(y[i]), np.uint64(x[i])
        number = (t[i] - origin) // duration
        begun = used[channel, row, column]
        slot = np.uint64((begun - 1) % depth)
        gap = np.float64((t[i] - origin) - number * duration)
        if begun and bins[channel, row, column, slot] == number:
            within[channel, row, column, slot, 0] += gap
            within[channel, row, column, slot, 1] += 1
        else:
            slot = np.uint64(begun % depth)
            used[channel, row, column] = begun + 1
            bins[channel, row, column, slot] = number
            within[channel, row, column, slot, 0], within[channel, row, column, slot, 1] = gap, 1


@njit
def ages_of_bins(since, duration, bins, within, used, out):
    """Put 1 - log(1 + age) / 8.7, not below 0, of what `queue_bins` kept into `out` [K, 2, H, W], the latest last.

    Ages are those `since` µs after the origin, in bins. O(pixels + kept bins).
    """
    _, height, width, depth = bins.shape
    for c in range(2):
        for row in range(height):
            for column in range(width):
                begun = used[c, row, column]
                for back in range(min(begun, depth)):
                    slot = (begun - 1 - back) % depth
                    at = (c, row, column, slot)
                    age = np.float64(since - bins[at] * duration) - within[at][0] / within[at][1]
                    out[depth - 1 - back, c, row, column] = max(1 - np.log1p(max(age / duration, 0.0)) / 8.7, 0.0)


@njit
def latest_ticks(t, x, y, p, start, tick, now, decay, out):
    """Put what is left of each pixel's latest event, as of 1, 2, ... ticks ago, into `out` [K, 2, H, W]. O(N K).

    1 in the tick of the event, and less by 1 / `decay` with each tick, not below 0. ON comes first.
    """
    for i in range(np.uint64(t.size)):
        channel, row, column = np.uint64(1 - p[i]), np.uint64(y[i]), np.uint64(x[i])
        age = now - 1 - (t[i] - start) // tick
        # filters that are delayed by more ticks haven't seen it yet
        for k in range(min(age + 1, out.shape[0])):
            left = np.float32(1 - np.float64(age - k) / decay)
            out[np.uint64(k), channel, row, column] = max(left, out[np.uint64(k), channel, row, column])
