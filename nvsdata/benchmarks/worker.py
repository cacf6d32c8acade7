"""Worker process: runs one library's calls."""

from __future__ import annotations

import os
import time
from importlib.metadata import PackageNotFoundError, version
from multiprocessing.connection import Connection
from typing import Any

from nvsdata.benchmarks.case import Case, Options, Ready
from nvsdata.benchmarks.line import OURS
from nvsdata.benchmarks.measure import peak_of, spent
from nvsdata.common.errors import line_of
from nvsdata.common.processes import end_with_parent

LONG = 1.0  # s, after which a call isn't repeated needlessly


def serve(connection: Connection, task: str, options: Options, library: str) -> None:
    """Answer `("prepare", key)`, `("turn", key, calls)` and `("drop",)` until the other end closes.

    Answers are a dict: what is known of the case, `{"spent": seconds of each call}`, or `{"missing"}`, `{"failed"}`
    with the reason.
    """
    end_with_parent()
    # one core, whoever does the work
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    from nvsdata.benchmarks.tasks import cases_of

    cases = {case.key: case for case in cases_of(task, options) if case.library == library}
    ready: dict[str, Ready] = {}
    while True:
        try:
            what, *given = connection.recv()
        except (EOFError, KeyboardInterrupt):
            return
        try:
            if what == "prepare":
                ready[given[0]] = cases[given[0]].make()
                answer = _known(cases[given[0]], ready[given[0]])
            elif what == "turn":
                answer = {"spent": spent(ready[given[0]], given[1])}
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
            # the other end was closed while the work was done
            return


def _known(case: Case, ready: Ready) -> dict[str, Any]:
    """Error, counters and memory of a case, and about how long a call takes."""
    known: dict[str, Any] = {"version": _version(case)}
    if ready.before is not None:
        ready.before()
    start = time.perf_counter()
    # compiles, too
    result = ready.run()
    first = time.perf_counter() - start
    known["error"] = None if ready.error is None else float(ready.error(result))
    known["counters"] = {} if ready.counters is None else dict(ready.counters(result))
    del result
    if ready.before is not None:
        ready.before()
    start = time.perf_counter()
    known["peak"] = peak_of(ready.run, case.device)
    known["once"] = time.perf_counter() - start
    if first < LONG:
        # reading the process' memory takes longer than a short call
        (known["once"],) = spent(ready, 1)
    return known


def _version(case: Case) -> str:
    if case.library == OURS:
        from nvsdata._version import __version__

        return __version__
    try:
        return version(case.package or case.library)
    except PackageNotFoundError:
        return ""
