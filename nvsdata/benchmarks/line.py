"""Result of one measurement, and files of such lines."""

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
class Line:
    """Time, error and memory of one piece of work by one library.

    - `task`: group of the work, such as `"decode"`
    - `work`: what is done; lines of the same work and `settings` differ only in the library
    - `library`, `version`: who does it
    - `settings`: what it is done with
    - `size`: amounts of the work, such as `{"events": 2_000_000}`
    - `axis`: the setting or size that changes along a curve; empty where there is none
    - `default`: whether these are the library's default settings
    - `error`, `error_kind`: distance from the exact result, and in what sense; None where there is no such result
    - `seconds`, `p95`, `p99`, `runs`: median and percentiles of single calls, and their number
    - `peak_memory`: bytes that a call needs in addition to what the process held; None if the system doesn't tell
    - `counters`: amounts of work done, the same in each run
    - `device`: of torch
    - `scope`: "quick" or "full", and whether on simulated or given data
    - `machine`, `commit`, `date`: where and when it was measured, and of which state of the code
    """

    task: str
    work: str
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
        """The fields that identify a measurement from run to run."""
        values = (f"{name}={value}" for group in (self.settings, self.size) for name, value in sorted(group.items()))
        return (self.task, self.work, self.library, self.device, self.scope, *values)

    @property
    def place(self) -> float:
        """Return the line's position on its axis; NaN if that isn't a number."""
        value = self.settings.get(self.axis, self.size.get(self.axis))
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def write_lines(lines: Iterable[Line], path: Path) -> None:
    """Write lines as JSON."""
    content = {"format": FORMAT, "version": 1, "lines": [asdict(line) for line in lines]}
    put(path, (json.dumps(content, indent=1, default=_plain) + "\n").encode(), through_link=True)


def read_lines(path: Path) -> list[Line]:
    """Lines of a file that `write_lines` wrote; ValueError for another file."""
    try:
        content = json.loads(path.read_text("utf-8"))
        if content["format"] != FORMAT:
            raise ValueError(f"its format is {content['format']!r}")
        known = {one.name for one in fields(Line)}
        return [Line(**{name: value for name, value in line.items() if name in known}) for line in content["lines"]]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{shown(path)}: not a file of `nvsdata bench --json`: {error}") from None


def _plain(value: Any) -> Any:
    """NumPy's numbers as Python's."""
    return value.item()
