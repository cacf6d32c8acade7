"""Damage to JSON, to arrays, and to the place of a file, for `fuzz_side_files.py`."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import trees
from structures import NUMBERS, changed

Rng = np.random.Generator
OLD = 10**18  # ns: when all files were changed


def choice(rng: Rng, options: Any) -> Any:
    return options[int(rng.integers(0, len(options)))]


def replaced(path: Path, rng: Rng, home: Path) -> bool:
    """Once in a while: something else in the place of a file."""
    if rng.random() > 0.1:
        return False
    path.unlink(missing_ok=True)
    kind = rng.integers(0, 6)
    if kind == 0:
        path.symlink_to(choice(rng, (home / "secret", home / "pipe", "/nothing/there", path, "..")))
    elif kind == 1:
        os.mkfifo(path)
    elif kind == 2:
        path.mkdir()
    elif kind == 3:
        path.write_bytes(b"")
    elif kind == 4:
        with path.open("wb") as file:
            file.truncate(3 << 30)
    return True


def put_back(folder: Path, sound: dict[str, bytes]) -> None:
    """A folder with these files only, none of them changed lately."""
    shutil.rmtree(folder, ignore_errors=True)
    trees.put(folder, sound)
    settle(folder)


def settle(folder: Path) -> None:
    for path in (*folder.rglob("*"), folder):
        os.utime(path, ns=(OLD, OLD), follow_symlinks=False)


def json_changed(value: Any, rng: Rng) -> Any:
    """JSON with one of its values, keys or entries changed."""
    others = (*NUMBERS, None, True, 0.5, float("nan"), [], {}, [[]])
    others += ("", "x", "../secret", "/etc/passwd", "a\0b", "\ud800")
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = choice(rng, list(value))
        kind = rng.integers(0, 8)
        if kind == 0:
            return {name: entry for name, entry in value.items() if name != key}
        if kind == 1:
            return value | {str(choice(rng, others)).encode("utf-8", "replace").decode(): value[key]}
        return value | {key: json_changed(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.9:
        at, kind = int(rng.integers(0, len(value))), rng.integers(0, 6)
        if kind == 0:
            return value[:at] + value[at + 1 :]
        if kind == 1:
            return [*value, value[at]]
        return [*value[:at], json_changed(value[at], rng), *value[at + 1 :]]
    if type(value) is int and rng.random() < 0.5:
        return value + int(choice(rng, (-1, 1, 1_000, -(10**6))))
    return choice(rng, others)


def array_changed(array: np.ndarray, rng: Rng) -> np.ndarray:
    """Other values or, less often, another shape or type."""
    kind = rng.integers(0, 8)
    if kind == 0:
        return array[: len(array) // 2] if array.ndim else array.reshape(1)
    if kind == 1:
        return np.concatenate((array, array)) if array.ndim else np.array([array, array])
    if kind == 2:
        with np.errstate(all="ignore"), suppress(OverflowError):
            return array.astype(choice(rng, ("u1", "i4", "f8", "?", ">i8", "u8", "S4")))
    if kind == 3:
        return array.reshape(choice(rng, ((-1,), (1, -1), (-1, 1))))
    return changed(array, rng)
