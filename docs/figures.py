"""Tables made from measurements in `docs/figures/`."""

from __future__ import annotations

from pathlib import Path

from nvsdata.benchmarks.curves import by_benchmark, exponent, is_scaling
from nvsdata.benchmarks.measurement import OURS, Measurement, read_measurements
from nvsdata.benchmarks.table import duration, number

BENCHMARKS = Path(__file__).parent / "figures" / "benchmarks.json"
ROUNDING = 1e-4  # errors up to this are rounding of float32


def comparison() -> list[tuple[str, ...]]:
    """Return a row for each benchmark that other libraries ran, too, after a head."""
    rows = [("task", "benchmark", "nvsdata", "other libraries: ratio", "meaning of a difference")]
    for group in by_benchmark(read_measurements(BENCHMARKS)):
        ours = next(one for one in group if one.library == OURS)
        if others := [one for one in group if one.library != OURS]:
            ratios = "; ".join(_ratio(one, ours) for one in others)
            kind = ours.error_kind if any(map(_differs, others)) else ""
            rows.append((ours.task, ours.benchmark, duration(ours.seconds), ratios, kind))
    return rows


def _ratio(other: Measurement, ours: Measurement) -> str:
    version = f" ({other.version})" if other.version else ""
    differs = f", differs by {number(other.error)}" if _differs(other) else ""
    return f"{other.library}{version}: {other.seconds / ours.seconds:.2f}{differs}"


def _differs(one: Measurement) -> bool:
    return one.error is not None and one.error > ROUNDING


def growth() -> list[tuple[str, ...]]:
    """Return a row for each benchmark of growing inputs, after a head."""
    rows = [("task", "input that grows", "smallest and largest", "exponent", "time and memory at the largest")]
    for group in by_benchmark(read_measurements(BENCHMARKS)):
        if is_scaling(group):
            ours = sorted((one for one in group if one.library == OURS), key=lambda one: one.place)
            first, last = ours[0], ours[-1]
            ends = f"{first.place:,.0f} and {last.place:,.0f} {last.axis}"
            memory = "" if last.peak_memory is None else f", {number(last.peak_memory / 1e6)} MB"
            cost = f"{duration(last.seconds)}{memory}"
            rows.append((last.task, last.benchmark, ends, f"{exponent(ours):.2f}", cost))
    return rows
