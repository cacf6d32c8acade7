"""Processes beside the test's own: dead ones, and ones that hold what a test wants."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager


def dead_owner() -> str:
    """The name, as in `nvsdata.common.locks`, of a process that has ended."""
    code = "from nvsdata.common.locks import owner; print(owner())"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


@contextmanager
def another_process(code: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process that runs `code`, and the first line that it printed; it is killed at the end of the block."""
    command = [sys.executable, "-c", textwrap.dedent(code)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line, "it ended before it was ready"
        yield process, line
    finally:
        process.kill()
        process.communicate()
