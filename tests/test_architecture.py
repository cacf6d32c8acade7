"""The house is as docs/design.md says: rooms in order, imports that point down, no circle."""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "nvsdata"
DESIGN = (ROOT / "docs/design.md").read_text(encoding="utf-8")


def documented():
    """The rooms and loose modules that the document lists, from the top down."""
    listed = DESIGN.split("\nnvsdata/\n", 1)[1].split("\nrecipes/", 1)[0]
    names = []
    for line in listed.splitlines():
        # what goes on from the line before is indented further
        if entry := re.match(r" {2}(\S.*?)(?:  |$)", line):
            names += [name.strip().removesuffix("/").removesuffix(".py") for name in entry[1].split(",")]
    return names


ORDER = documented()


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imports_of(path):
    """Every module of ours that a file imports, within functions, too; a package's name stands for its __init__."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                found.add(name if name in MODULES else node.module)
    return {name for name in found if name.split(".")[0] == "nvsdata"}


@cache
def imports():
    return {module: imports_of(path) for module, path in MODULES.items()}


def room_of(module):
    return module.split(".")[1] if "." in module else "nvsdata"


def test_the_document_lists_every_room_and_no_other():
    there = {path.stem for path in PACKAGE.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert set(ORDER) == there - {"__init__"}
    assert len(ORDER) == len(set(ORDER))


@pytest.mark.parametrize("module", [module for module in MODULES if module != "nvsdata"])
def test_imports_point_down(module):
    place = ORDER.index(room_of(module))
    for imported in imports()[module]:
        # public names are for users
        assert imported != "nvsdata", f"{module} imports a public name: import it from its room"
        assert ORDER.index(room_of(imported)) >= place, f"{module} imports {imported}, which lies above it"


def test_no_circles():
    try:
        TopologicalSorter({module: names - {module} for module, names in imports().items()}).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_the_document_names_modules_that_are_there():
    """Every name.py that the list mentions for a room lies in it."""
    listed = DESIGN.split("\nnvsdata/\n", 1)[1].split("\nrecipes/", 1)[0]
    stems = {path.name for path in PACKAGE.rglob("*.py")}
    assert set(re.findall(r"\b\w+\.py\b", listed)) <= stems


@pytest.mark.parametrize("package", [module for module, path in MODULES.items() if path.name == "__init__.py"])
def test_no_name_of_a_package_hides_its_module(package):
    """`from nvsdata.models import x` gives a function or a module of that name, not either by what was imported."""
    names = {
        alias.asname or alias.name
        for node in ast.walk(ast.parse(MODULES[package].read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module in MODULES
        for alias in node.names
        if f"{node.module}.{alias.name}" not in MODULES
    }
    assert not {name for name in names if f"{package}.{name}" in MODULES}


@pytest.mark.parametrize("document", sorted((ROOT / "docs").glob("*.md")), ids=lambda path: path.name)
def test_documents_name_files_that_are_there(document):
    there = {path.name for folder in ("nvsdata", "recipes", "tests", "docs") for path in (ROOT / folder).rglob("*.py")}
    named = set(re.findall(r"\b[a-z]\w*\.py\b", document.read_text(encoding="utf-8")))
    # one of them stands for any recipe
    assert named - {"recipe.py"} <= there


# what changes while it lives: writers, cameras, searches
CHANGING = {
    "DavisDecoder",
    "FolderReport",
    "Format",
    "Outlines",
    "PackReport",
    "PlaybackLog",
    "RecordingReport",
    "Search",
    "ClassSummary",
    "SimulatedDavis",
    "FrameSpikes",
    "Status",
    "ScreenRecording",
    "Tally",
    "Watched",
    "_Budget",
}


def test_dataclasses_are_frozen_unless_they_live_by_change():
    found = set()
    for path in (ROOT / "nvsdata").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                made = [ast.unparse(one) for one in node.decorator_list if "dataclass" in ast.unparse(one)]
                found |= {node.name for one in made if "frozen=True" not in one}
    assert found == CHANGING


def test_a_class_name_has_one_meaning():
    """Classes have unique names, and no type variable has the name of a class."""
    classes, variables = [], set()
    for path in MODULES.values():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                classes.append(node.name)
            if isinstance(node, ast.Assign) and ast.unparse(node.value).startswith("TypeVar("):
                variables |= {ast.unparse(target) for target in node.targets}
    assert sorted({name for name in classes if classes.count(name) > 1} | variables.intersection(classes)) == []
