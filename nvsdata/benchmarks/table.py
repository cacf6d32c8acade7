"""Tables of measurements as text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from nvsdata.benchmarks.curves import bends_upward, exponent, is_scaling
from nvsdata.benchmarks.measurement import OURS, Measurement
from nvsdata.common.errors import shown
from nvsdata.common.text import aligned

HEAD = ("", "error", "median", "p95", "p99", "runs", "peak", "ratio to ours", "counters")
NOTED = 1.3  # ratio of times above which a comparison marks a measurement


def benchmark_table(measurements: Sequence[Measurement]) -> str:
    """Return the table of one benchmark; if it has several sizes, also the growth of its cost."""
    own = [one for one in measurements if one.library == OURS]
    ours = {_label(one): one.seconds for one in own}
    rows: list[tuple[str, ...]] = [(f"{measurements[0].task}: {measurements[0].benchmark}", *HEAD[1:])]
    for one in measurements:
        ratio = "" if one.library == OURS or _label(one) not in ours else f"{one.seconds / ours[_label(one)]:.2f}"
        text = " ".join(part for part in (f"{one.library} {one.version}".strip(), _label(one)) if part)
        peak = "" if one.peak_memory is None else f"{one.peak_memory / 1e6:.1f} MB"
        times = (duration(seconds) for seconds in (one.seconds, one.p95, one.p99))
        counters = ", ".join(f"{value:,} {name}" for name, value in one.counters.items())
        rows.append((f"  {text}", number(one.error), *times, str(one.runs), peak, ratio, counters))
    # names are aligned to the left, numbers to the right; empty columns are left out
    width = max(len(row[0]) for row in rows)
    filled = [i for i in range(1, len(HEAD)) if any(row[i] for row in rows[1:])]
    text = aligned([(row[0].ljust(width), *(row[i] for i in filled)) for row in rows])
    if kind := next((one.error_kind for one in measurements if one.error_kind), ""):
        text += f"\n  error: {shown(kind)}"
    if is_scaling(measurements):
        bent = ", and bends upward" if bends_upward(own) else ""
        text += f"\n  grows as {shown(measurements[0].axis)}^{exponent(own):.2f}{bent}"
    return text


def _label(one: Measurement) -> str:
    """Return settings and size as text."""
    text = [f"{name} {value}" for name, value in one.settings.items()]
    text += [f"{value:,} {name}" for name, value in one.size.items()]
    return ", ".join(text)


def number(value: float | None) -> str:
    """Format a number with three significant digits, or as a whole number from 1,000 on; empty for None and NaN.

    Example:
        >>> number(0.12345), number(12345.6)
        ('0.123', '12,346')
    """
    if value is None or math.isnan(value):
        return ""
    return f"{value:,.0f}" if 999.5 <= abs(value) < 1e9 else f"{value:z.3g}"


def duration(seconds: float) -> str:
    """Format a time with three significant digits and a unit.

    Args:
        seconds: Time in s.

    Example:
        >>> duration(0.0012345)
        '1.23 ms'
    """
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def comparison(measurements: Sequence[Measurement], old: Sequence[Measurement]) -> str:
    """Return a table of each measurement and the same one of an earlier run.

    It has the ratio of times, and errors if they differ.
    """
    before: Mapping[tuple[str, ...], Measurement] = {one.key: one for one in old}
    rows = [("", "before", "now", "now / before", "error before", "error now")]
    for one in measurements:
        was = before.get(one.key)
        if was is None:
            continue
        ratio = one.seconds / was.seconds
        mark = "  slower" if ratio > NOTED else "  faster" if ratio < 1 / NOTED else ""
        errors = ("", "") if one.error == was.error else (number(was.error), number(one.error))
        name = " ".join(part for part in (f"{one.task}: {one.benchmark}", one.library, _label(one)) if part)
        rows.append((name, duration(was.seconds), duration(one.seconds), f"{ratio:.2f}{mark}", *errors))
    if len(rows) == 1:
        return "the earlier file has none of these measurements"
    width = max(len(row[0]) for row in rows)
    text = shown(f"before: commit {old[0].commit}, {old[0].date}, {old[0].machine}")
    return f"{text}\n" + aligned([(row[0].ljust(width), *row[1:]) for row in rows])
