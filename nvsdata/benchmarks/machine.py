"""Description of the machine and of the version of the code."""

from __future__ import annotations

import os
import platform
import subprocess
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path

from nvsdata._version import __version__

ROOT = Path(__file__).parents[2]


@cache
def machine() -> str:
    """Describe the processor, cores, memory and system, and the versions of Python, torch and NumPy."""
    parts = [_processor(), f"{os.cpu_count()} cores"]
    with suppress(ValueError, OSError, AttributeError):
        parts.append(f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.0f} GiB")
    parts += [f"{platform.system()} {platform.release()}", f"Python {platform.python_version()}"]
    parts += [f"{name} {version(name)}" for name in ("torch", "numpy")]
    return ", ".join(parts)


@cache
def commit() -> str:
    """Return the Git commit of this checkout, with a "+" if files have changed; outside a checkout, the version."""
    if not (ROOT / ".git").exists():
        return __version__
    try:
        name, changed = (
            subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
            for words in (("rev-parse", "--short=12", "HEAD"), ("status", "--porcelain", "-uno"))
        )
    except (OSError, subprocess.CalledProcessError):
        return __version__
    return f"{name}+" if changed else name


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
