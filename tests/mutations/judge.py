"""The test command of the mutations: the tests of the changed module's room first, then all others.

Ends with pytest's exit code; the first failure ends it. The changed module is what differs from the last commit.
"""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"
# whose own tests stand elsewhere, or are slow to say what others say at once
FIRST = {
    "kernels": ["kernels", "transforms", "models", "formats", "data", "emulation", "metrics"],
    "commands": ["commands", "recipes"],
    "training": ["training", "recipes"],
    "plots": ["plots", "training"],
}


def main() -> int:
    changed = subprocess.run(
        ["git", "diff", "--name-only", "--", "nvsdata"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    if len(changed) != 1:
        sys.exit(f"one file must be changed, not {changed or 'none'}: commit first")
    near = rooms(changed[0])
    return run(near) or run(path for path in sorted(TESTS.iterdir()) if is_tests(path) and path not in near)


def rooms(module: str) -> list[Path]:
    """Folders of tests to run first: those of the module's room."""
    room = Path(module).parts[1]
    return [TESTS / name for name in FIRST.get(room, [room]) if (TESTS / name).is_dir()]


def is_tests(path: Path) -> bool:
    """Whether pytest finds tests at a path."""
    return path.name.startswith("test_") or (path.is_dir() and any(path.rglob("test_*.py")))


def run(paths) -> int:
    """pytest's exit code for the tests at the paths; 0 if there are none."""
    found = [str(path) for path in paths]
    if not found:
        return 0
    flags = ["-n", "1", "-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb", "line"]
    return subprocess.run([sys.executable, "-m", "pytest", *flags, *found], cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
