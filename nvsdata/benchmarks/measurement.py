"""Result of one measurement, and JSON files of results."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from nvsdata.common.errors import shown
from nvsdata.common.files import put

FORMAT = "nvsdata-bench"
OURS = "nvsdata"
Plain = str | int | float | bool | None


@dataclass(frozen=True)
class Measurement:
    """Time, error and memory of one benchmark, run by one library with one choice of settings.

    Args:
        task: Group of the benchmark, such as "decode".
        benchmark: Name of the benchmark. Measurements of the same benchmark and settings differ only in the library.
        library: Library that was measured.
        version: Version of the library.
        seconds: Median time of a call in s.
        p95: 95th percentile of the times in s.
        p99: 99th percentile of the times in s.
        runs: Number of timed calls.
        settings: Settings of the library.
        size: Size of the input, such as {"events": 2_000_000}.
        axis: Name of the setting or size that varies along a curve; empty if there is no curve.
        default: Whether these are the library's default settings.
        error: Distance from the exact result; None if there is no exact result.
        error_kind: Definition of the error.
        peak_memory: Bytes that a call needs in addition to the memory of the process; None where the system doesn't
            report it.
        counters: Amounts in the result, such as {"edges": 5_000}; the same in each run.
        device: Device of torch.
        scope: "quick" or "full", and whether data was simulated or given.
        machine: Processor, memory and system.
        commit: Commit or version of nvsdata.
        date: Date of the measurement, ISO 8601.
    """

    task: str
    benchmark: str
    library: str
    version: str
    seconds: float
    p95: float
    p99: float
    runs: int
    settings: Mapping[str, Plain] = field(default_factory=dict)
    size: Mapping[str, int] = field(default_factory=dict)
    axis: str = ""
    default: bool = False
    error: float | None = None
    error_kind: str = ""
    peak_memory: int | None = None
    counters: Mapping[str, int] = field(default_factory=dict)
    device: str = "cpu"
    scope: str = ""
    machine: str = ""
    commit: str = ""
    date: str = ""

    @property
    def key(self) -> tuple[str, ...]:
        """Fields that identify the same measurement in an earlier run."""
        values = (f"{name}={value}" for group in (self.settings, self.size) for name, value in sorted(group.items()))
        return (self.task, self.benchmark, self.library, self.device, self.scope, *values)

    @property
    def place(self) -> float:
        """Position of the measurement on its axis; NaN if it isn't a number."""
        value = self.settings.get(self.axis, self.size.get(self.axis))
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def write_measurements(measurements: Iterable[Measurement], path: Path) -> None:
    """Write measurements to a JSON file."""
    content = {"format": FORMAT, "version": 1, "measurements": [asdict(measurement) for measurement in measurements]}
    put(path, (json.dumps(content, indent=1, default=_plain) + "\n").encode(), through_link=True)


def read_measurements(path: Path) -> list[Measurement]:
    """Read a file of `write_measurements`.

    Raises:
        ValueError: The file has other contents.
    """
    try:
        content = json.loads(path.read_text("utf-8"))
        if content["format"] != FORMAT:
            raise ValueError(f"its format is {content['format']!r}")
        known = {one.name for one in fields(Measurement)}
        return [
            Measurement(**{name: value for name, value in measurement.items() if name in known})
            for measurement in content["measurements"]
        ]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{shown(path)}: not a file of `nvsdata bench --json`: {error}") from None


def _plain(value: Any) -> Any:
    """Convert a number of NumPy to one of Python."""
    return value.item()
