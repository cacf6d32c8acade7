"""Which functions use a compiled kernel: coverage doesn't see into kernels, and numba doesn't see that they change."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
KERNELS = ROOT / "nvsdata" / "kernels"
Function = tuple[str, str]  # module and name


def is_kernel(module: str) -> bool:
    """Whether a module's functions are compiled."""
    return Path(module).parts[1] == "kernels"


def forget(module: str) -> None:
    """Remove what numba kept of a kernel's module and of those that use it: it would go on with the old code."""
    stale, found = set(), {Path(module).stem}
    while found:
        stale |= found
        found = {path.stem for path in KERNELS.glob("*.py") if stale & {name for name, _ in imported(path).values()}}
        found -= stale
    for name in stale:
        for kept in (KERNELS / "__pycache__").glob(f"{name}.*.nb?"):
            kept.unlink()


def uses(module: str, lines: set[int]) -> Iterator[tuple[Path, list[int]]]:
    """Files that call a kernel that holds some of the lines, directly or through others, and the lines that name it."""
    path = ROOT / module
    changed = {(path.stem, function.name) for function in functions(path) if lines & span(function)}
    # a constant of the module: any of its functions
    changed = changed or {(path.stem, function.name) for function in functions(path)}
    size = 0
    while size < len(changed):
        size = len(changed)
        changed |= {
            (kernel.stem, function.name)
            for kernel in KERNELS.glob("*.py")
            for function in functions(kernel)
            if mentions(function, names(kernel, changed), {})
        }
    for folder in ("nvsdata", "tests"):
        for file in (ROOT / folder).rglob("*.py"):
            if file.parent == KERNELS:
                continue
            wanted = {alias: {name for kernel, name in changed if kernel == module} for alias, module in modules(file)}
            if found := mentions(ast.parse(file.read_text()), names(file, changed), wanted):
                yield file, found


def functions(path: Path) -> list[ast.FunctionDef]:
    """Functions of a module."""
    return [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)]


def span(function: ast.FunctionDef) -> set[int]:
    """The lines of a function, its decorators' included."""
    first = min([function.lineno, *(decorator.lineno for decorator in function.decorator_list)])
    return set(range(first, function.end_lineno + 1))


def imported(path: Path) -> dict[str, Function]:
    """What a file takes from kernels: module and name, by the name that it has there."""
    found = {}
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("nvsdata.kernels."):
            module = node.module.rpartition(".")[2]
            found |= {alias.asname or alias.name: (module, alias.name) for alias in node.names}
    return found


def names(path: Path, changed: set[Function]) -> set[str]:
    """What the changed functions are called in a file."""
    own = {name for module, name in changed if path.parent == KERNELS and module == path.stem}
    return own | {name for name, function in imported(path).items() if function in changed}


def modules(path: Path) -> Iterator[tuple[str, str]]:
    """Kernel modules that a file imports as such: what it calls each, and its name."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module == "nvsdata.kernels":
            yield from ((alias.asname or alias.name, alias.name) for alias in node.names)


def mentions(tree: ast.AST, wanted: set[str], within: dict[str, set[str]]) -> list[int]:
    """Lines where any of the names is used, or any of those `within` a module."""
    lines = [node.lineno for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id in wanted]
    dotted = (node for node in ast.walk(tree) if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name))
    return lines + [node.lineno for node in dotted if node.attr in within.get(node.value.id, ())]
