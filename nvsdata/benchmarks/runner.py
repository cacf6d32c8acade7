"""Measures cases: each library in a process of its own, and all that do the same work in turns.

So a slow phase of the machine affects all of them, and no library suffers from what another one imports or keeps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import date
from itertools import groupby
from multiprocessing import get_context
from typing import Any

import numpy as np

from nvsdata.benchmarks.case import Case, Options
from nvsdata.benchmarks.line import OURS, Line
from nvsdata.benchmarks.machine import commit, machine
from nvsdata.benchmarks.tasks import cases_of
from nvsdata.benchmarks.worker import serve

TURN = 0.03  # s of calls per turn, at least one call
ROUNDS, FEW = 9, 5  # turns of each, at most FEW if quick
LONG = 3.0  # s after which no further turn is taken
MOST_CALLS = 1000  # per turn


@dataclass(frozen=True)
class LeftOut:
    """A case without a line.

    - `case`: what should have been measured
    - `reason`: why it wasn't
    - `failed`: whether it failed, rather than being unavailable here
    """

    case: Case
    reason: str
    failed: bool


class Worker:
    """The process of one library; a context manager, which ends it."""

    def __init__(self, task: str, options: Options, library: str) -> None:
        self._work = task, options, library
        self._start()

    def _start(self) -> None:
        context = get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=serve, args=(other, *self._work), daemon=False)
        self._process.start()
        other.close()

    def ask(self, *what: Any) -> dict[str, Any]:
        """Send a request and wait for its answer; `{"failed"}` if the process ended instead, and a new one begins."""
        try:
            self._connection.send(what)
            answer: dict[str, Any] = self._connection.recv()
        except (EOFError, OSError):
            self._process.join(5)
            code = self._process.exitcode
            self._start()
            return {"failed": f"its process ended with exit code {code}"}
        return answer

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()
        self._process.join(5)
        self._process.kill()
        self._process.join()


def measure_task(
    task: str, options: Options, *, peers: bool = False, wanted: Callable[[Case], bool] = lambda case: True
) -> Iterator[Line | LeftOut]:
    """Lines of a task, and what was left out.

    - `task`: a name in `TASKS`
    - `options`: options of all tasks
    - `peers`: other libraries, too (default False)
    - `wanted`: which cases to measure (default: all)
    """
    cases = [case for case in cases_of(task, options) if (peers or case.library == OURS) and wanted(case)]
    with ExitStack() as stack:
        workers: dict[str, Worker] = {}
        for case in cases:
            if case.library not in workers:
                workers[case.library] = stack.enter_context(Worker(task, options, case.library))
        numbered = enumerate(cases)
        for _, group in groupby(numbered, key=lambda pair: (pair[1].work, pair[0] if pair[1].alone else -1)):
            yield from _in_turns([case for _, case in group], workers, options)


def _in_turns(cases: Sequence[Case], workers: dict[str, Worker], options: Options) -> Iterator[Line | LeftOut]:
    known: dict[str, dict[str, Any]] = {}
    for case in cases:
        answer = workers[case.library].ask("prepare", case.key)
        if reason := answer.get("missing") or answer.get("failed"):
            yield LeftOut(case, reason, "failed" in answer)
        else:
            known[case.key] = answer | {"spent": [answer["once"]] if answer["once"] >= LONG else []}
    running = [case for case in cases if case.key in known]
    for _ in range(FEW if options.quick else ROUNDS):
        for case in running:
            found = known[case.key]
            if (not found["spent"] or sum(found["spent"]) < LONG) and "failed" not in found:
                calls = min(max(int(TURN / max(found["once"], 1e-9)), 1), MOST_CALLS)
                answer = workers[case.library].ask("turn", case.key, calls)
                found["spent"] += answer.get("spent", [])
                found |= {name: text for name, text in answer.items() if name == "failed"}
    for worker in {case.library: workers[case.library] for case in cases}.values():
        worker.ask("drop")
    for case in running:
        found = known[case.key]
        yield LeftOut(case, found["failed"], True) if "failed" in found else _line(case, found, options)


def _line(case: Case, found: dict[str, Any], options: Options) -> Line:
    median, p95, p99 = np.percentile(found["spent"], (50, 95, 99)).tolist()
    return Line(
        task=case.task,
        work=case.work,
        library=case.library,
        version=found["version"],
        seconds=median,
        p95=p95,
        p99=p99,
        runs=len(found["spent"]),
        settings=dict(case.settings),
        size=dict(case.size),
        axis=case.axis,
        default=case.default,
        error=found["error"],
        error_kind=case.error_kind,
        peak_memory=found["peak"],
        counters=found["counters"],
        device=case.device,
        scope=f"{'quick' if options.quick else 'full'}, {'given data' if options.data else 'simulated'}",
        machine=machine(),
        commit=commit(),
        date=date.today().isoformat(),
    )
