"""Lines as text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from nvsdata.benchmarks.curves import bends_upward, exponent, is_scaling
from nvsdata.benchmarks.line import OURS, Line
from nvsdata.common.errors import shown
from nvsdata.common.text import aligned

HEAD = ("", "error", "median", "p95", "p99", "runs", "peak", "ratio to ours", "work")
NOTED = 1.3  # ratio of times from which a comparison marks a line


def work_table(lines: Sequence[Line]) -> str:
    """The table of one work, and below it how its cost grows."""
    own = [line for line in lines if line.library == OURS]
    ours = {_what(line): line.seconds for line in own}
    rows: list[tuple[str, ...]] = [(f"{lines[0].task}: {lines[0].work}", *HEAD[1:])]
    for line in lines:
        ratio = "" if line.library == OURS or _what(line) not in ours else f"{line.seconds / ours[_what(line)]:.2f}"
        text = " ".join(part for part in (f"{line.library} {line.version}".strip(), _what(line)) if part)
        peak = "" if line.peak_memory is None else f"{line.peak_memory / 1e6:.1f} MB"
        times = (duration(seconds) for seconds in (line.seconds, line.p95, line.p99))
        work = ", ".join(f"{value:,} {name}" for name, value in line.counters.items())
        rows.append((f"  {text}", number(line.error), *times, str(line.runs), peak, ratio, work))
    # names to the left, figures to the right; no column that says nothing
    width = max(len(row[0]) for row in rows)
    told_columns = [i for i in range(1, len(HEAD)) if any(row[i] for row in rows[1:])]
    text = aligned([(row[0].ljust(width), *(row[i] for i in told_columns)) for row in rows])
    if kind := next((line.error_kind for line in lines if line.error_kind), ""):
        text += f"\n  error: {shown(kind)}"
    if is_scaling(lines):
        bent = ", and bends upward" if bends_upward(own) else ""
        text += f"\n  grows as {shown(lines[0].axis)}^{exponent(own):.2f}{bent}"
    return text


def _what(line: Line) -> str:
    """Settings and size, in words."""
    text = [f"{name} {value}" for name, value in line.settings.items()]
    text += [f"{value:,} {name}" for name, value in line.size.items()]
    return ", ".join(text)


def number(value: float | None) -> str:
    """Three digits."""
    return "" if value is None or math.isnan(value) else "0" if value == 0 else f"{value:.3g}"


def duration(seconds: float) -> str:
    """Three digits, with a unit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def comparison(lines: Sequence[Line], old: Sequence[Line]) -> str:
    """Compare each line with the same line of an earlier run: ratio of times, and errors if they differ."""
    before: Mapping[tuple[str, ...], Line] = {line.key: line for line in old}
    rows = [("", "before", "now", "now / before", "error before", "error now")]
    for line in lines:
        was = before.get(line.key)
        if was is None:
            continue
        ratio = line.seconds / was.seconds
        mark = "  slower" if ratio > NOTED else "  faster" if ratio < 1 / NOTED else ""
        errors = ("", "") if line.error == was.error else (number(was.error), number(line.error))
        name = " ".join(part for part in (f"{line.task}: {line.work}", line.library, _what(line)) if part)
        rows.append((name, duration(was.seconds), duration(line.seconds), f"{ratio:.2f}{mark}", *errors))
    if len(rows) == 1:
        return "none of these lines is in the earlier file"
    width = max(len(row[0]) for row in rows)
    text = shown(f"before: commit {old[0].commit}, {old[0].date}, {old[0].machine}")
    return f"{text}\n" + aligned([(row[0].ljust(width), *row[1:]) for row in rows])
