"""Build backend: scikit-build-core, with the C++ compiler of the PyPI package `ziglang` where there is no other."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from scikit_build_core import build
from scikit_build_core.build import (
    build_sdist,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

COMPILERS = ("c++", "g++", "clang++", "cl")
NO_COMPILER = (
    "nvsdata's kernels are C++17, and no C++ compiler was found. Install one (Debian, Ubuntu: apt install g++; Fedora: "
    "dnf install gcc-c++; macOS: xcode-select --install), name one by the environment variable CXX, or "
    "pip install ziglang, which contains one"
)


def _has_compiler() -> bool:
    # Visual Studio's is not on the path: CMake finds it
    return os.name == "nt" or bool(os.environ.get("CXX")) or any(map(shutil.which, COMPILERS))


def _with_zig(required: list[str]) -> list[str]:
    return required if _has_compiler() else [*required, "ziglang"]


def get_requires_for_build_wheel(settings: Any = None) -> list[str]:
    """Return the requirements for building a wheel."""
    return _with_zig(build.get_requires_for_build_wheel(settings))


def get_requires_for_build_editable(settings: Any = None) -> list[str]:
    """Return the requirements for building an editable installation."""
    return _with_zig(build.get_requires_for_build_editable(settings))


def build_wheel(folder: str, settings: Any = None, metadata: str | None = None) -> str:
    """Build a wheel."""
    with _compiler():
        wheel: str = build.build_wheel(folder, settings, metadata)
    return wheel


def build_editable(folder: str, settings: Any = None, metadata: str | None = None) -> str:
    """Build an editable wheel."""
    with _compiler():
        wheel: str = build.build_editable(folder, settings, metadata)
    return wheel


@contextmanager
def _compiler() -> Iterator[None]:
    """Let CMake use the compiler of zig, by scripts, because CMake takes the path of a compiler without arguments."""
    if _has_compiler():
        yield
        return
    if importlib.util.find_spec("ziglang") is None:
        raise SystemExit(NO_COMPILER)
    with tempfile.TemporaryDirectory(prefix="nvsdata-zig-") as folder:
        # for any processor, not only this one: CMakeLists.txt asks for x86-64-v2 in words that zig does not know
        cpu = f"-mcpu={'x86_64_v2' if platform.machine() == 'x86_64' else 'baseline'}"
        for name, command in (("CC", f"cc {cpu}"), ("CXX", f"c++ {cpu}"), ("AR", "ar"), ("RANLIB", "ranlib")):
            script = Path(folder, name)
            script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ziglang {command} "$@"\n')
            script.chmod(0o755)
            os.environ[name] = str(script)
        yield
