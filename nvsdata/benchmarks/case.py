"""A piece of work that can be measured, and what it needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nvsdata.benchmarks.line import OURS, Plain


@dataclass(frozen=True)
class Options:
    """Options of all tasks.

    - `scratch`: folder for files that are read or written
    - `quick`: small sizes, so that all tasks together take less than ten minutes
    - `device`: of torch, for networks
    - `data`: folder with recordings of real sensors; None takes what nvsdata can make itself
    """

    scratch: Path
    quick: bool = False
    device: str = "cpu"
    data: Path | None = None


@dataclass(frozen=True)
class Ready:
    """Work that only waits for its call.

    - `run`: the work that is timed
    - `error`: distance of its result from the exact one; called once, before anything is timed
    - `before`: called before each call, not timed
    - `counters`: amounts of work that the result stands for
    """

    run: Callable[[], Any]
    error: Callable[[Any], float] | None = None
    before: Callable[[], Any] | None = None
    counters: Callable[[Any], Mapping[str, int]] | None = None


@dataclass(frozen=True)
class Case:
    """A line before it is measured; the fields of the same name are those of `Line`.

    - `make`: prepares the work, in the process that will do it; ImportError leaves the case out
    - `package`: whose version is reported (default: `library`)
    - `alone`: not in turns with the other cases of the same work, because they would need too much memory together
    """

    task: str
    work: str
    make: Callable[[], Ready]
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
        """Distinguishes the cases of a task."""
        return f"{self.work} | {self.library} | {dict(self.settings)} | {dict(self.size)}"
