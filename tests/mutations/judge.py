"""The test command of the mutations: the tests that run the changed line, the nearest first.

Ends with pytest's exit code; the first failure ends it. The changed module is what differs from the last commit. Which
tests run a line is read from `.coverage`, which pytest-cov writes (docs/contributing.md). For lines that run at import
or in other processes, and without a map, it's all tests that run anything of the module, or stand in its room. Last
come the tests of whole commands in processes of their own, which leave no trace in the map.
"""

import ast
import subprocess
import sys
import tempfile
from pathlib import Path

import coverage

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"
MAP = ROOT / ".coverage"
TIME = 400  # s, after which a loop is taken to be endless
# whose own tests stand elsewhere, or are slow to say what others say at once
FIRST = {
    "kernels": ["kernels", "transforms", "models", "formats", "data", "emulation", "metrics"],
    "commands": ["commands", "recipes"],
    "training": ["training", "recipes"],
    "plots": ["plots", "training"],
}
IN_PROCESSES = ("cli.py", "commands", "common", "emulation", "recording", "training", "video")


def main() -> int:
    """Judge the change that stands in the working tree."""
    changed, lines = change()
    tests = running(changed, lines)
    code = run(sorted(tests or near(changed), key=lambda test: distance(changed, test)))
    processes = (TESTS / "faults").glob("test_*.py") if Path(changed).parts[1] in IN_PROCESSES else ()
    return code or run(sorted(path.relative_to(ROOT).as_posix() for path in processes))


def near(module: str) -> set[str]:
    """Tests that run anything of a module, those of its room, and those of the whole."""
    room = Path(module).parts[1]
    folders = [TESTS / name for name in FIRST.get(room, [room])]
    files = [*TESTS.glob("test_*.py"), *(path for folder in folders for path in folder.rglob("test_*.py"))]
    return once({path.relative_to(ROOT).as_posix() for path in files} | running(module, all_lines(module)))


def change() -> tuple[str, set[int]]:
    """The changed module, and the lines of the statements that were changed, as numbered in the last commit."""
    diff = ["git", "diff", "-U0", "--", "nvsdata"]
    text = subprocess.run(diff, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    files = [line.removeprefix("--- a/") for line in text if line.startswith("--- ")]
    if len(files) != 1:
        sys.exit(f"one file must be changed, not {files or 'none'}: commit first")
    old = subprocess.run(["git", "show", f"HEAD:{files[0]}"], cwd=ROOT, capture_output=True, text=True, check=True)
    lines = set()
    for hunk in (line.split()[1] for line in text if line.startswith("@@")):
        first, _, count = hunk.lstrip("-").partition(",")
        for line in range(int(first), int(first) + max(int(count or 1), 1)):
            lines |= statement(ast.parse(old.stdout), line)
    return files[0], lines


def statement(tree: ast.AST, line: int) -> set[int]:
    """Lines of the smallest statement around a line; of one with a body, those before it."""
    lines = {line}
    for node in ast.walk(tree):
        if isinstance(node, ast.stmt) and node.lineno <= line <= node.end_lineno:
            end = node.body[0].lineno - 1 if getattr(node, "body", None) else node.end_lineno
            if line <= end:
                lines = set(range(node.lineno, end + 1))
    return lines


def running(module: str, lines: set[int]) -> set[str]:
    """Tests that run any of the lines; whole files of tests where a fixture does; none if it's not known."""
    if not MAP.exists():
        return set()
    data = coverage.CoverageData(str(MAP))
    data.read()
    # another clone's map has other folders
    ran = data.contexts_by_lineno(next((path for path in data.measured_files() if path.endswith(module)), module))
    contexts = {context for line in lines for context in ran.get(line, ())}
    split = [context.rpartition("|") for context in contexts if "|" in context]
    return once({test if phase == "run" else test.partition("::")[0] for test, _, phase in split})


def all_lines(module: str) -> set[int]:
    """The numbers of a module's lines."""
    return set(range(1, len((ROOT / module).read_text().splitlines()) + 1))


def once(tests: set[str]) -> set[str]:
    """Tests without those of files that are among them."""
    return {test for test in tests if "::" not in test or test.partition("::")[0] not in tests}


def distance(module: str, test: str) -> tuple:
    """How far a test is from a module: its own file first, then its room, then the others."""
    stem, room = Path(module).stem, Path(module).parts[1]
    file = test.partition("::")[0]
    # the whole command line takes longest
    return stem not in file, Path(file).parts[1] != room, "commands" in file or "recipes" in file, file


def run(tests) -> int:
    """pytest's exit code for tests, by path or name; 0 if there are none, 1 if they don't end."""
    found = [str(test) for test in tests]
    if not found:
        return 0
    flags = ["-n", "0", "-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb", "line"]
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as listed:
        listed.write("\n".join(found))
        listed.flush()
        try:
            done = subprocess.run([sys.executable, "-m", "pytest", *flags, f"@{listed.name}"], cwd=ROOT, timeout=TIME)
        except subprocess.TimeoutExpired:
            print(f"not done after {TIME} s")
            return 1
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
