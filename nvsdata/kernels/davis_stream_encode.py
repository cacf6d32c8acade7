"""Words as DAVIS cameras send them (logic 18), for simulated cameras."""

from __future__ import annotations

from nvsdata.kernels.compiling import njit


@njit
def encode(t, x, y, p, state, words):
    """Words of events, as a camera sends them: a new time before its row, a row before its columns. O(N).

    `t` int64 µs, not decreasing; `x`, `y`, `p`; `state` int64 [3]: µs of the wraps so far, the last time and row
    sent, -1 for none. `words` uint16 must have room for 4 N words and one per wrap. Returns how many were written.
    """
    n = 0
    for i in range(t.size):
        fresh = t[i] != state[1]
        if fresh:
            wraps = (t[i] - state[0]) >> 15
            state[0] += wraps << 15
            while wraps > 0:
                step = min(wraps, 4095)
                words[n] = 0x7000 | step
                n += 1
                wraps -= step
            if t[i] > state[0]:
                words[n] = 0x8000 | (t[i] - state[0])
                n += 1
            state[1] = t[i]
        if fresh or y[i] != state[2]:
            words[n] = 0x1000 | y[i]
            n += 1
            state[2] = y[i]
        words[n] = (0x3000 if p[i] else 0x2000) | x[i]
        n += 1
    return n
