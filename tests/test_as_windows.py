"""The main jobs without what POSIX alone has: no fork, no pread, and no file replaced that is open."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
PRETENDED = HERE / "as_windows"
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux pretends to be Windows")


def ran(*words, **more):
    paths = [PRETENDED, HERE, HERE.parent]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))}
    return subprocess.run(
        [sys.executable, *map(str, words)], env=environment, capture_output=True, text=True, timeout=300, **more
    )


@pytest.mark.parametrize(
    ("code", "error"),
    [
        ("import os; os.fork()", "AttributeError"),
        ("import os; os.preadv", "AttributeError"),
        ("import multiprocessing; multiprocessing.get_context('fork')", "ValueError"),
        ("import os; kept = open('a', 'w'); os.remove('a')", "PermissionError"),
        ("import os; kept = open('a', 'w'); open('b', 'w').close(); os.replace('b', 'a')", "PermissionError"),
        ("import os, numpy; kept = numpy.memmap('a', 'u1', 'w+', shape=9); os.remove('a')", "PermissionError"),
        ("open('a:b', 'w')", "OSError"),
        ("open('con.txt', 'w')", "OSError"),
    ],
)
def test_the_pretence_holds(tmp_path, code, error):
    done = ran("-c", code, cwd=tmp_path)
    assert f"\n{error}: " in done.stderr


def test_the_main_jobs(tmp_path):
    done = ran(PRETENDED / "jobs.py", tmp_path, cwd=tmp_path)
    assert (done.returncode, done.stdout.splitlines()[-1:]) == (0, ["all done"]), done.stderr
