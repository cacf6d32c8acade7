"""Measurement of cases: each library runs in a separate process, and calls of the libraries are interleaved.

So a slow phase of the machine affects all libraries alike, and imports or memory of one library don't affect another.
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
from nvsdata.benchmarks.machine import commit, machine
from nvsdata.benchmarks.measurement import OURS, Measurement
from nvsdata.benchmarks.tasks import cases_of
from nvsdata.benchmarks.worker import serve

ROUND_TIME = 0.03  # s of calls of a case in a round, at least one call
ROUNDS, QUICK_ROUNDS = 9, 5  # rounds of each case; the second if quick
LONG = 3.0  # s of calls of a case, after which it takes part in no further round
MOST_CALLS = 1000  # per round


@dataclass(frozen=True)
class SkippedCase:
    """Case without a measurement.

    Args:
        case: The case.
        reason: Reason why it wasn't measured.
        failed: True if it failed, False if the library isn't installed.
    """

    case: Case
    reason: str
    failed: bool


class Worker:
    """Process of one library; a context manager that ends it.

    Args:
        task: Name of the task.
        options: Options of the task.
        library: Name of the library.
    """

    def __init__(self, task: str, options: Options, library: str) -> None:
        self._arguments = task, options, library
        self._start()

    def _start(self) -> None:
        context = get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=serve, args=(other, *self._arguments), daemon=False)
        self._process.start()
        other.close()

    def ask(self, *what: Any) -> dict[str, Any]:
        """Send a request to the process, and return its answer.

        If the process ended without an answer, a new one is started, and the answer is {"failed": reason}.
        """
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
) -> Iterator[Measurement | SkippedCase]:
    """Yield the measurements of a task, and the cases that were skipped.

    Args:
        task: A name in `TASKS`.
        options: Options of all tasks.
        peers: Measure other libraries, too (default False).
        wanted: Function that selects cases (default: all).
    """
    cases = [case for case in cases_of(task, options) if (peers or case.library == OURS) and wanted(case)]
    with ExitStack() as stack:
        workers: dict[str, Worker] = {}
        for case in cases:
            if case.library not in workers:
                workers[case.library] = stack.enter_context(Worker(task, options, case.library))
        numbered = enumerate(cases)
        for _, group in groupby(numbered, key=lambda pair: (pair[1].benchmark, pair[0] if pair[1].alone else -1)):
            yield from _interleaved([case for _, case in group], workers, options)


def _interleaved(
    cases: Sequence[Case], workers: dict[str, Worker], options: Options
) -> Iterator[Measurement | SkippedCase]:
    known: dict[str, dict[str, Any]] = {}
    for case in cases:
        answer = workers[case.library].ask("prepare", case.key)
        if reason := answer.get("missing") or answer.get("failed"):
            yield SkippedCase(case, reason, "failed" in answer)
        else:
            known[case.key] = answer | {"spent": [answer["once"]] if answer["once"] >= LONG else []}
    running = [case for case in cases if case.key in known]
    for _ in range(QUICK_ROUNDS if options.quick else ROUNDS):
        for case in running:
            found = known[case.key]
            if (not found["spent"] or sum(found["spent"]) < LONG) and "failed" not in found:
                calls = min(max(int(ROUND_TIME / max(found["once"], 1e-9)), 1), MOST_CALLS)
                answer = workers[case.library].ask("time", case.key, calls)
                found["spent"] += answer.get("spent", [])
                found |= {name: text for name, text in answer.items() if name == "failed"}
    for worker in {case.library: workers[case.library] for case in cases}.values():
        worker.ask("drop")
    for case in running:
        found = known[case.key]
        yield SkippedCase(case, found["failed"], True) if "failed" in found else _measurement(case, found, options)


def _measurement(case: Case, found: dict[str, Any], options: Options) -> Measurement:
    median, p95, p99 = np.percentile(found["spent"], (50, 95, 99)).tolist()
    return Measurement(
        task=case.task,
        benchmark=case.benchmark,
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
