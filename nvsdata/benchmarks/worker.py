"""Worker process: runs one library's calls."""

from __future__ import annotations

import os
import time
from importlib.metadata import PackageNotFoundError, version
from multiprocessing.connection import Connection
from typing import Any

from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.measure import peak_memory, time_calls
from nvsdata.benchmarks.measurement import OURS
from nvsdata.common.errors import line_of
from nvsdata.common.processes import end_with_parent

THREADS = "OMP_NUM", "MKL_NUM", "OPENBLAS_NUM", "RAYON_NUM", "POLARS_MAX"  # names in the environment, without _THREADS
LONG = 1.0  # s, after which a call isn't repeated needlessly


def serve(connection: Connection, task: str, options: Options, library: str) -> None:
    """Answer requests until the other end of the connection closes.

    Requests are tuples, answers dicts:

    - `("prepare", key)` makes the case of this key and runs it. The answer is that of `_checked`.
    - `("time", key, calls)` calls a prepared case `calls` times. The answer is {"spent": seconds of each call}.
    - `("drop",)` releases all prepared cases. The answer is empty.

    If the library isn't installed, the answer is {"missing": reason}. After any other exception it is {"failed":
    reason}.

    Args:
        connection: Connection to the process that measures.
        task: Name of the task.
        options: Options of the task.
        library: Library whose cases this process runs.
    """
    end_with_parent()
    # every library computes on one core
    os.environ.update(dict.fromkeys((f"{name}_THREADS" for name in THREADS), "1"))
    from nvsdata.benchmarks.tasks import cases_of

    cases = {case.key: case for case in cases_of(task, options) if case.library == library}
    ready: dict[str, PreparedCase] = {}
    while True:
        try:
            what, *given = connection.recv()
        except (EOFError, KeyboardInterrupt):
            return
        try:
            if what == "prepare":
                ready[given[0]] = cases[given[0]].make()
                answer = _checked(cases[given[0]], ready[given[0]])
            elif what == "time":
                answer = {"spent": time_calls(ready[given[0]], given[1])}
            else:
                ready.clear()
                answer = {}
        except ImportError as error:
            answer = {"missing": line_of(error)}
        except KeyboardInterrupt:
            return
        except Exception as error:
            answer = {"failed": f"{type(error).__name__}: {line_of(error)}"}
        try:
            connection.send(answer)
        except (BrokenPipeError, ConnectionResetError):
            # the other end was closed during the work
            return


def _checked(case: Case, ready: PreparedCase) -> dict[str, Any]:
    """Run a case; return its error, counters and peak memory, and the approximate time of a call in s."""
    known: dict[str, Any] = {"version": _version(case)}
    if ready.before is not None:
        ready.before()
    start = time.perf_counter()
    # the first call may compile
    result = ready.run()
    first = time.perf_counter() - start
    known["error"] = None if ready.error is None else float(ready.error(result))
    known["counters"] = {} if ready.counters is None else dict(ready.counters(result))
    del result
    if ready.before is not None:
        ready.before()
    start = time.perf_counter()
    known["peak"] = peak_memory(ready.run, case.device)
    known["once"] = time.perf_counter() - start
    if first < LONG:
        # for short calls, measuring memory would distort the time
        (known["once"],) = time_calls(ready, 1)
    return known


def _version(case: Case) -> str:
    if case.library == OURS:
        from nvsdata._version import __version__

        return __version__
    try:
        return version(case.package or case.library)
    except PackageNotFoundError:
        return ""
