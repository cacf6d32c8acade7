"""Try mutations of the C++ kernels: one operator or number changed, all compiled, the tests of that subject run.

    python tests/mutations/native.py --count 60 --seed 0
    python tests/mutations/native.py --count 20 --subjects graph metrics --start 20

Subjects (folders of nvsdata/kernels) take turns, and within each the kinds of change. Left out is what no test can see:
comments, texts of errors, template arguments, polls for Ctrl-C, code of other platforms. What doesn't compile, or
compiles to the same bytes, doesn't count. --start goes on in the same order where another run ended. Ends with the
original file and module in place.
"""

import argparse
import os
import random
import re
import resource
import shutil
import subprocess
import sys
from itertools import islice, zip_longest
from pathlib import Path

ROOT = Path(__file__).parents[2]
KERNELS = ROOT / "nvsdata" / "kernels"
BUILD, PRISTINE = ROOT / "build" / "mutants", ROOT / "build" / "pristine"
TIME = 300  # s, after which a loop is taken to be endless
LATE = 124  # the exit code then
MEMORY = 24 << 30  # bytes of address space, for sizes that a mutation made huge
# after tests/kernels/SUBJECT: tests of callers, the fastest first
CALLERS = {
    "decode": "formats data/test_events.py datasets/store",
    "emulate": "emulation",
    "graph": "transforms/test_edges.py models/test_spline.py models/test_pool.py models/test_graph_cnn.py",
    "metrics": "metrics",
    "native": "kernels",
    "recording": "recording/davis",
    "represent": "transforms",
    "streaming": "models/incremental transforms/test_causal_filters.py",
}
SWAPS = ["< <=", "> >=", "== !=", "+ -", "&& ||"]
UNSEEN = re.compile(
    r"^#if(?:def)? (?:_WIN32|_MSC_VER|NVSDATA_BOUNDS)\n[^#]*|//[^\n]*|^ *#.*|\"(?:[^\"\\]|\\.)*\""
    r"|(?<=\w)<(?![\s<=])[^;{}()]*?>|^ *template <.*|\bthrow [^;]*|static_assert.*"
    r"|^.*(?:\bpoll|[iI]nterrupt|OFTEN|PATIENCE|cpu_supports).*",
    re.MULTILINE,
)
Change = tuple[Path, int, int, str]  # file, from character, up to another, new text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60, help="mutations that compile (default 60)")
    parser.add_argument("--seed", type=int, default=0, help="default 0")
    parser.add_argument("--start", type=int, default=0, help="first mutation of the order (default 0)")
    parser.add_argument("--subjects", nargs="+", default=sorted(CALLERS), choices=sorted(CALLERS))
    args = parser.parse_args()
    configure = ["cmake", "-S", KERNELS, "-B", BUILD, "-G", "Ninja", f"-DPython_EXECUTABLE={sys.executable}"]
    subprocess.run(configure, check=True, stdout=subprocess.DEVNULL)
    original = build()
    if original is None:
        sys.exit("the kernels don't compile")
    shutil.rmtree(PRISTINE, ignore_errors=True)
    shutil.copytree(BUILD, PRISTINE)
    tried, survived, broken = 0, 0, []
    for number, change in islice(enumerate(drawn(args.subjects, args.seed)), args.start, None):
        if tried == args.count:
            break
        said = judged(change, original, broken)
        # a test that fails on the original code, too, notices nothing
        while said.startswith("tests/") and run([said], [])[0]:
            broken.append(said)
            print(f"fails without a mutation: {said}", flush=True)
            said = judged(change, original, broken)
        tried += said not in ("doesn't compile", "same bytes")
        survived += said == "SURVIVED"
        print(f"{number}: {described(change)}: {said}", flush=True)
    print(f"{tried} mutations, {tried - survived} noticed, {survived} not")


def drawn(subjects: list[str], seed: int) -> list[Change]:
    """All mutations in the order of trial: subjects take turns, and kinds of change within them."""
    rng = random.Random(seed)
    rows = []
    for subject in subjects:
        kinds: dict[str, list[Change]] = {}
        for path in sorted([*(KERNELS / subject).glob("*.cpp"), *(KERNELS / subject).glob("*.h")]):
            for kind, change in changes(path):
                kinds.setdefault(kind, []).append(change)
        for found in kinds.values():
            rng.shuffle(found)
        order = rng.sample(sorted(kinds), len(kinds))
        rows.append([change for turn in zip_longest(*(kinds[kind] for kind in order)) for change in turn if change])
    return [change for turn in zip_longest(*rows) for change in turn if change]


def changes(path: Path):
    """Each mutation of a file, with its kind."""
    code = UNSEEN.sub(lambda found: re.sub(r"[^\n]", "~", found[0]), path.read_text())
    for swap in SWAPS:
        for found in re.finditer("|".join(rf"(?<= ){re.escape(sign)}(?= |\n)" for sign in swap.split()), code):
            yield swap, (path, *found.span(), next(sign for sign in swap.split() if sign != found[0]))
    for found in re.finditer(r"(?<=std::)(min|max)(?=\()", code):
        yield "min max", (path, *found.span(), "max" if found[0] == "min" else "min")
    for found in re.finditer(r"(?<![\w.'])(?<!\de-)(0x[\dA-F]+|\d+)(?![\w.'])", code):
        plus = int(found[0], 0) + 1
        yield "number", (path, *found.span(), hex(plus) if "x" in found[0] else str(plus))
    for found in re.finditer(r"(?<=\bif )\(", code):
        depth, end = 1, found.end()
        while depth:
            depth += {"(": 1, ")": -1}.get(code[end], 0)
            end += 1
        yield "condition", (path, found.start(), end, f"(!{path.read_text()[found.start() : end]})")


def described(change: Change) -> str:
    """A mutation's file, line and code, with the old part and the new one in brackets."""
    path, start, end, new = change
    code = path.read_text()
    first, last = code.rfind("\n", 0, start) + 1, (code + "\n").find("\n", end)
    line = f"{code[first:start]}[[{code[start:end]} => {new}]]{code[end:last]}"
    return f"{path.relative_to(KERNELS)}:{code.count(chr(10), 0, start) + 1}: {' '.join(line.split())}"


def judged(change: Change, original: bytes, broken: list[str]) -> str:
    """What becomes of a mutation; the file and the module are restored."""
    path, start, end, new = change
    code, times = path.read_text(), path.stat()
    try:
        path.write_text(code[:start] + new + code[end:])
        module = build()
        if module is None or module == original:
            return "doesn't compile" if module is None else "same bytes"
        return noticed(path.parent.name, broken) or "SURVIVED"
    finally:
        path.write_text(code)
        shutil.rmtree(BUILD)
        shutil.copytree(PRISTINE, BUILD)
        # objects of the copy aren't older than the file: nothing is compiled twice
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        build()


def build() -> bytes | None:
    """Compile what has changed and put the module in its place; None if it doesn't compile."""
    done = subprocess.run(["cmake", "--build", BUILD, "-j1"], capture_output=True)
    module = next(BUILD.glob("_native*"), None)
    if done.returncode or module is None:
        return None
    # a new file: the old one may be mapped by another process
    (KERNELS / module.name).unlink(missing_ok=True)
    shutil.copy(module, KERNELS)
    return module.read_bytes()


def noticed(subject: str, broken: list[str]) -> str:
    """The test that notices a changed module, or how the tests ended; empty if they pass."""
    for names in [f"kernels/{subject}"], CALLERS[subject].split():
        tests = [path for path in (ROOT / "tests" / name for name in names) if path.exists()]
        code, output = run(tests, broken) if tests else (0, "")
        if code:
            found = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", output, re.MULTILINE)
            return found[1] if found else "not done in time" if code == LATE else f"exit code {code}"
    return ""


def run(tests: list, broken: list[str]) -> tuple[int, str]:
    """pytest's exit code and output; `broken` tests are left out."""
    flags = ["-n", "0", "-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb", "line", "-rfE"]
    command = [sys.executable, "-m", "pytest", *flags, *(f"--deselect={test}" for test in broken), *tests]
    try:
        done = subprocess.run(command, cwd=ROOT, timeout=TIME, capture_output=True, text=True, preexec_fn=_limit)
    except subprocess.TimeoutExpired:
        return LATE, ""
    return done.returncode, done.stdout


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    main()
