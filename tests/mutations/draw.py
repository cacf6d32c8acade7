"""Choose which of cosmic-ray's mutations are tried: a random part, spread over the code, of those that mean something.

    python tests/mutations/draw.py SESSION --count 200
    python tests/mutations/draw.py SESSION --count 200 --part 1 2

A place in the code is drawn first, then one of the mutations there: operators have ten mutations each, numbers two.
Left out is what no test can see: type annotations, code for type checkers, decorators that make code faster. The same
seed draws the same; with --part N OF, only each OF-th of them, for sessions that run side by side in clones.
"""

import argparse
import ast
import random
from collections import defaultdict
from functools import cache
from pathlib import Path

import coverage
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import WorkerOutcome, WorkResult
from judge import MAP

FASTER = {"cache", "lru_cache", "cached_property", "wraps"}
Span = tuple[tuple[int, int], tuple[int, int]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("session", type=Path, help="file that `cosmic-ray init` made")
    parser.add_argument("--count", type=int, default=200, help="mutations to try (default 200)")
    parser.add_argument("--seed", type=int, default=0, help="default 0")
    parser.add_argument("--part", type=int, nargs=2, default=(1, 1), metavar=("N", "OF"), help="default 1 1: all")
    args = parser.parse_args()
    if not tells_tests():
        parser.error(f"{MAP} doesn't tell which tests run a line: was it made as docs/contributing.md says?")
    with use_db(args.session, WorkDB.Mode.open) as session:
        items = sorted(session.work_items, key=lambda item: _key(item.mutations[0]))
        chosen = drawn(items, args.count, args.seed)[args.part[0] - 1 :: args.part[1]]
        kept = {item.job_id for item in chosen}
        left = [item.job_id for item in items if item.job_id not in kept]
        session.set_multiple_results(left, WorkResult(WorkerOutcome.SKIPPED))
    for item in chosen:
        change = item.mutations[0]
        print(f"{change.module_path}:{change.start_pos[0]} {change.operator_name.removeprefix('core/')}")


def tells_tests() -> bool:
    """Whether the map has a context for each test; without `--dist no`, pytest-cov writes none."""
    found = coverage.CoverageData(str(MAP))
    found.read()
    return any("|" in context for context in found.measured_contexts())


def drawn(items: list, count: int, seed: int) -> list:
    """`count` of the work items, each of another place, in the order of the code."""
    places = defaultdict(list)
    for item in items:
        change = item.mutations[0]
        if not is_unseen(change.module_path, change.start_pos, change.operator_name):
            places[str(change.module_path), change.start_pos].append(item)
    rng = random.Random(seed)
    return [rng.choice(places[place]) for place in sorted(rng.sample(sorted(places), min(count, len(places))))]


def is_unseen(path: Path, place: tuple[int, int], operator: str) -> bool:
    """Whether a mutation at a place changes nothing that a test could see."""
    unseen, faster = spans(path)
    within = [start <= place < end for start, end in unseen]
    return any(within) or ("RemoveDecorator" in operator and any(start <= place < end for start, end in faster))


@cache
def spans(path: Path) -> tuple[list[Span], list[Span]]:
    """Where annotations and code for type checkers are, and where decorators that make code faster."""
    unseen, faster = [], []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            unseen.append(node)
        unseen += [part for part in (getattr(node, "annotation", None), getattr(node, "returns", None)) if part]
        for decorator in getattr(node, "decorator_list", ()):
            called = decorator.func if isinstance(decorator, ast.Call) else decorator
            if ast.unparse(called).rpartition(".")[2] in FASTER:
                faster.append(decorator)
    return [_span(node) for node in unseen], [_span(node, before=1) for node in faster]


def _span(node: ast.AST, before: int = 0) -> Span:
    return (node.lineno, node.col_offset - before), (node.end_lineno, node.end_col_offset)


def _key(change) -> tuple:
    return str(change.module_path), change.start_pos, change.operator_name, change.occurrence


if __name__ == "__main__":
    main()
