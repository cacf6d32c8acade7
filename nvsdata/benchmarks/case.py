"""Cases of benchmarks: one library with one choice of settings each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nvsdata.benchmarks.measurement import OURS, Plain


@dataclass(frozen=True)
class Options:
    """Options of all tasks.

    Args:
        scratch: Folder for files that benchmarks read or write.
        quick: Use small sizes, so that all tasks together take less than ten minutes (default False).
        device: Device of torch for networks (default "cpu").
        data: Folder with recordings of real sensors (default None: synthetic scenes).
    """

    scratch: Path
    quick: bool = False
    device: str = "cpu"
    data: Path | None = None


@dataclass(frozen=True)
class PreparedCase:
    """Case that is ready to be timed.

    Args:
        run: Function that is timed.
        error: Function of its result that returns the distance from the exact result. It is called once, before
            anything is timed (default None: there is no exact result).
        before: Function that is called before each call of `run` and isn't timed (default None).
        counters: Function of the result that returns amounts, such as {"edges": 5_000} (default None).
    """

    run: Callable[[], Any]
    error: Callable[[Any], float] | None = None
    before: Callable[[], Any] | None = None
    counters: Callable[[Any], Mapping[str, int]] | None = None


@dataclass(frozen=True)
class Case:
    """Case that isn't measured yet. Fields that aren't listed here have the meaning of those of `Measurement`.

    Args:
        make: Function that prepares the case, in the process that will run it. If it raises ImportError, the case is
            skipped.
        package: Package whose version is reported (default: `library`).
        alone: Measure the case separately, not interleaved with the other cases of the benchmark, because together
            they would need too much memory (default False).
    """

    task: str
    benchmark: str
    make: Callable[[], PreparedCase]
    library: str = OURS
    settings: Mapping[str, Plain] = field(default_factory=dict)
    size: Mapping[str, int] = field(default_factory=dict)
    axis: str = ""
    default: bool = False
    error_kind: str = ""
    package: str = ""
    alone: bool = False
    device: str = "cpu"

    @property
    def key(self) -> str:
        """Name of the case, unique within its task."""
        return f"{self.benchmark} | {self.library} | {dict(self.settings)} | {dict(self.size)}"
