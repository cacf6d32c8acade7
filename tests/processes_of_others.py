"""Processes beside the test's own: dead ones, and ones that hold what a test wants."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any


def dead_owner() -> str:
    """The name, as in `nvsdata.common.locks`, of a process that has ended."""
    code = "from nvsdata.common.locks import owner; print(owner())"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def by_torchrun(count: int, script: Path, *words: object) -> subprocess.CompletedProcess[str]:
    """Run a script by several processes."""
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(count)]
    command = [*launch, *map(str, (script, *words))]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=environment)


def answer(connection: Connection, function: Callable[[Any], Any]) -> None:
    """Send the result of a function for what comes."""
    connection.send(function(connection.recv()))


def blocked(_: object) -> bool:
    """Return True if Ctrl-C is blocked in this process."""
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@contextmanager
def another_process(code: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process that runs `code`, and the first line that it printed; it is killed at the end of the block."""
    command = [sys.executable, "-c", textwrap.dedent(code)]
    # for `code` that imports this module
    paths = [str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line, "it ended before it was ready"
        yield process, line
    finally:
        process.kill()
        process.communicate()
