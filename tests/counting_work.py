"""What tests count in place of timing: elements that loops touch, calls, bytes that a process reads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
PROCESS = Path("/proc/thread-self/io")  # of the thread that asks: others may hear from whoever runs the tests


class Watched(np.ndarray):
    """An array that counts the elements that are read from it and written to it, in a `Counter` that its parts share.

    Only indexing counts: that's what compiled loops do, which then run as plain Python.
    """

    def __array_finalize__(self, other):
        self.tally = getattr(other, "tally", None)
        self.name = getattr(other, "name", "")

    def __getitem__(self, key):
        found = super().__getitem__(key)
        if not isinstance(found, Watched) and self.tally is not None:
            self.tally[self.name, "read"] += 1
        return found

    def __iter__(self):
        if self.ndim == 1 and self.tally is not None:
            self.tally[self.name, "read"] += self.size
        return super().__iter__()

    def __setitem__(self, key, value):
        if self.tally is not None:
            self.tally[self.name, "written"] += np.ndarray.__getitem__(self.view(np.ndarray), key).size
        super().__setitem__(key, value)

    def __array_ufunc__(self, ufunc, method, *inputs, **more):
        # whole-array results are plain, and what is compared or added as a whole is read as a whole
        plain = [self._whole(a) for a in inputs]
        if "out" in more:
            more["out"] = tuple(a.view(np.ndarray) if isinstance(a, Watched) else a for a in more["out"])
        return getattr(ufunc, method)(*plain, **more)

    @staticmethod
    def _whole(array: Any) -> Any:
        if not isinstance(array, Watched):
            return array
        if array.tally is not None:
            array.tally[array.name, "read"] += array.size
        return array.view(np.ndarray)


def watched(array: np.ndarray, name: str, tally: Counter) -> Watched:
    """A view of an array whose uses are counted under a name."""
    shown = array.view(Watched)
    shown.name, shown.tally = name, tally
    return shown


def counted(module: Any, name: str, tally: Counter, size: Callable[..., int] = lambda *_: 1) -> None:
    """Replace a function of a module by one that counts its calls, or a `size` of each call by its arguments."""
    function = getattr(module, name)

    @wraps(function)
    def counting(*arguments, **more):
        tally[name] += size(*arguments)
        return function(*arguments, **more)

    setattr(module, name, counting)


class _Numpy:
    """numpy, but new arrays are watched."""

    def __init__(self, name: str, tally: Counter) -> None:
        self._name, self._tally = name, tally

    def __getattr__(self, name):
        found = getattr(np, name)
        if name not in ("empty", "zeros", "ones", "full", "empty_like", "zeros_like"):
            return found

        def made(*given, **more):
            array = found(*given, **more)
            self._tally[self._name, "made"] += array.size
            return watched(array, self._name, self._tally)

        return made


@contextmanager
def touches(*modules: Any, calls: tuple[str, ...] = ()) -> Iterator[Counter]:
    """Counts what loops of some modules read, write and make, by module, while the block runs.

    Also the `calls` of functions of these modules, by name. Arguments count if they are `watched`.
    """
    tally: Counter = Counter()
    kept = [dict(vars(module)) for module in modules]
    for module in modules:
        module.np = _Numpy(module.__name__.rpartition(".")[2], tally)
        for name in calls:
            if vars(module).get("__name__") == getattr(vars(module).get(name), "__module__", None):
                counted(module, name, tally)
    try:
        yield tally
    finally:
        for module, names in zip(modules, kept, strict=True):
            vars(module).update(names)


def flat(tally: Counter) -> dict[str, int]:
    """Counts by words, and `touched`: all that was read and written."""
    total = sum(count for key, count in tally.items() if not isinstance(key, str) and key[1] != "made")
    return {key if isinstance(key, str) else " ".join(key): count for key, count in tally.items()} | {"touched": total}


@contextmanager
def bytes_read() -> Iterator[Counter]:
    """Counts the bytes that this thread got from files by system calls while the block runs; Linux only."""
    tally: Counter = Counter()
    before, own = _look()
    yield tally
    # the first look was read after it had been counted
    tally["bytes"] = _look()[0] - before - own


def _look() -> tuple[int, int]:
    """Bytes that the thread has got so far, and those that this look takes."""
    text = PROCESS.read_text()
    return int(text.split()[1]), len(text)


def uncompiled(script: Path) -> Any:
    """What a script prints as JSON, run in a process of its own in which kernels are plain Python."""
    places = os.pathsep.join((str(ROOT), str(ROOT / "tests")))
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": places, "PYTHONWARNINGS": "ignore"}
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
