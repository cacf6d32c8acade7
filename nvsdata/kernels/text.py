"""Lines of decimal numbers to event columns."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

NEWLINE, RETURN, SPACE, TAB, COMMA, MINUS, DOT, HASH = 10, 13, 32, 9, 44, 45, 46, 35

# Faults of a line
OK, BAD_NUMBER, BAD_COUNT, OUT_OF_RANGE, TOO_LATE = 0, 1, 2, 3, 4
LATEST = 2**62


@njit
def text_decode(raw, start, stop, seconds_first, skip_faults, columns):
    """Parse lines of four numbers between bytes `start` and `stop`. O(bytes).

    `seconds_first`: the line is `t x y p` with t in seconds (kept exact: digits, not floats,
    rounded down to the µs); otherwise `x y t p`, all integers, t in µs.
    `columns`: int64 [4, M] to fill with t, x, y, p, M at least the number of lines.
    Returns (events, fault code, byte offset of the fault, lines dropped). The first fault ends the parsing,
    unless `skip_faults`. Empty lines and lines beginning with `#` are skipped.
    """
    kept = dropped = 0
    i = start
    values = np.empty(4, np.int64)
    while i < stop:
        found, fault, where, i = _line(raw, i, stop, seconds_first, values)
        if found == 0 and fault == OK:
            continue
        if seconds_first:
            t, x, y = values[0], values[1], values[2]
        else:
            t, x, y = values[2], values[0], values[1]
        if fault == OK and (x < 0 or y < 0 or x > 32766 or y > 32766 or values[3] < -1 or values[3] > 1):
            fault = OUT_OF_RANGE
        if fault == OK and (t <= -LATEST or t >= LATEST):
            fault = TOO_LATE
        if fault != OK:
            if not skip_faults:
                return kept, fault, where, dropped
            dropped += 1
            continue
        columns[0, kept] = t
        columns[1, kept] = x
        columns[2, kept] = y
        columns[3, kept] = max(values[3], 0)
        kept += 1
    return kept, OK, 0, dropped


@njit
def _line(raw, i, stop, seconds_first, values):
    """Numbers of the line at byte i: (how many, fault code, where, byte after the line)."""
    where = i
    found = 0
    fault = OK
    comment = raw[i] == HASH
    while i < stop and raw[i] != NEWLINE:
        c = raw[i]
        if comment or fault != OK or c in (SPACE, TAB, COMMA, RETURN):
            i += 1
            continue
        if found == 4:
            fault = BAD_COUNT
            continue
        value, at, good = _number(raw, i, stop, seconds_first and found == 0)
        if not good:
            fault = BAD_NUMBER
            where = i = at
            continue
        i = at
        values[found] = value
        found += 1
    if fault == OK and 0 < found < 4:
        fault = BAD_COUNT
    return found, fault, where, i + 1


@njit
def _number(raw, i, stop, seconds):
    """One decimal number at byte i: (value, byte after it, whether it is one).

    With `seconds`, a decimal fraction is allowed and the value is in µs. Without, a number may end
    in `.0`; any other fraction is refused. A number beyond int64 is refused in any case.
    """
    negative = raw[i] == MINUS
    if negative:
        i += 1
    value = np.int64(0)
    digits = 0
    while i < stop and 48 <= raw[i] <= 57:
        digits += 1
        if digits > 18 and value > (2**63 - 10) // 10:
            return value, i, False
        value = value * 10 + (raw[i] - 48)
        i += 1
    if digits == 0:
        return value, i, False
    decimals = 6 if seconds else 0
    if seconds and value > (2**63 - 1) // 1_000_000 - 1:
        return value, i, False
    if i < stop and raw[i] == DOT:
        i += 1
        while i < stop and 48 <= raw[i] <= 57:
            if decimals > 0:
                value = value * 10 + (raw[i] - 48)
                decimals -= 1
            elif not seconds and raw[i] != 48:
                return value, i, False
            i += 1
    for _ in range(decimals):
        value *= 10
    if i < stop and not (raw[i] == SPACE or raw[i] == TAB or raw[i] == COMMA or raw[i] == RETURN or raw[i] == NEWLINE):
        return value, i, False
    return (-value if negative else value), i, True
