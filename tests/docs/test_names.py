"""Names in the documents exist: modules, public names, files, tests and options."""

import ast
import importlib
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
PAGES += sorted((ROOT / "recipes").rglob("*.md"))
CODE = re.compile(r"(?<!`)`([^`\n]+(?:\n[^`\n]+)?)`(?!`)")
FENCE = re.compile(r"^(```+).*?^\1", re.MULTILINE | re.DOTALL)
# pages that are not searched: coming-from.md has names of other libraries, contributing.md options of other tools
OTHERS = {"docs/coming-from.md", "docs/contributing.md"}
ALLOWED = {
    "nvsdata.networks": "a group of entry points",
    "recipe.py": "any recipe",
    "ToFrame": "of tonic",
    "DataLoader": "of torch",
    "LayerNorm": "of torch",
    "StatefulDataLoader": "of torchdata",
    "use_distributed_sampler": "of Lightning",
    "Data": "of PyTorch Geometric",
    "Batch": "of PyTorch Geometric",
    "GATConv": "of PyTorch Geometric",
    "WeightedRandomSampler": "of torch",
    "huggingface_hub": "of Hugging Face",
    "dynamic_shapes": "of torch.export",
    "edge_dim": "of PyTorch Geometric",
    "slider_depth": "a public recording",
    "real_everything": "a file of the reader's",
    "evt3_sample": "a public recording",
    "--install": "of a shell",
    "--logdir": "of tensorboard",
    "--nproc-per-node": "of torchrun",
}


@cache
def inline_code():
    """Page and text of each piece of inline code."""
    pages = [(page.relative_to(ROOT).as_posix(), FENCE.sub("", page.read_text("utf-8"))) for page in PAGES]
    return [
        (name, code.replace("\n", " ")) for name, text in pages if name not in OTHERS for code in CODE.findall(text)
    ]


@cache
def sources(*folders):
    """The text of all sources below some folders."""
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.*"))]
    own = Path(__file__).name
    return "\n".join(
        path.read_text("utf-8") for path in files if path.suffix in (".py", ".cpp", ".h") and path.name != own
    )


def resolves(dotted):
    """Whether a dotted name leads to a module or an attribute."""
    first, *rest = dotted.split(".")
    thing = importlib.import_module(first)
    for depth, part in enumerate(rest, 1):
        if not hasattr(thing, part):
            try:
                importlib.import_module(".".join([first, *rest[:depth]]))
            except ModuleNotFoundError:
                return False
        thing = getattr(thing, part)
    return True


def in_package(name):
    """Whether a name of a package that is named without `nvsdata.` exists; T is `nvsdata.transforms`."""
    return resolves("nvsdata." + re.sub(r"^T\b", "transforms", name))


def is_file(name):
    """Whether a path exists, from the repository or from any folder in it."""
    name = name.rstrip("/.")
    return any(list(ROOT.glob(start + name)) for start in ("", "tests/**/", "nvsdata/**/", "recipes/**/"))


def is_test(name):
    """Whether a test is defined; three dots stand for the rest of its name."""
    return re.search(rf"\bdef {name[:-3] if name.endswith('...') else name + '[(]'}", sources("tests")) or is_file(
        name + ".py"
    )


def is_class(name):
    return name in ("True", "False", "None") or re.search(
        rf"^ *(class {name}\b|{name}\b.* = )", sources("nvsdata"), re.M
    )


def is_option(name):
    return f'"{name}"' in sources("nvsdata", "recipes", "tests")


@cache
def words():
    return set(re.findall(r"\w+", sources("nvsdata", "recipes", "tests")))


def is_identifier(name):
    return name in words() or is_file(f"{name}.py")


CHECKS = {
    "modules": (r"(?<![\w./-])nvsdata(?:\.[A-Za-z_]\w*)+", resolves),
    "names of packages": (
        r"(?<![\w./-])(?:T|models|emulation|metrics|formats|plots|training|compat)(?:\.[A-Za-z_]\w*)+(?!/)",
        in_package,
    ),
    "files": (r"(?<![\w./-])(?:(?:nvsdata|tests|docs|recipes)/[\w./*-]+|[\w/]+\.(?:py|h|cpp)\b)", is_file),
    "tests": (r"(?<![\w/])test_\w+(?:\.\.\.)?(?!\w*[./{])", is_test),
    "classes": (r"(?<![\w./-])[A-Z]\w*[a-z]\w*(?=\(|$)", is_class),
    "options": (r"(?<![\w-])--[a-z][\w-]+", is_option),
    "identifiers": (r"(?<![\w./-])(?!test_)[a-z]\w*_\w+", is_identifier),
}


def missing(kind):
    """Page and name of each match of a kind that doesn't exist."""
    pattern, exists = CHECKS[kind]
    names = sorted({(page, hit[0]) for page, code in inline_code() for hit in re.finditer(pattern, code)})
    return [f"{page}: {name}" for page, name in names if name not in ALLOWED and not exists(name)]


@pytest.mark.parametrize("kind", CHECKS)
def test_names_in_the_documents_exist(kind):
    assert missing(kind) == []


def test_names_that_are_allowed_occur():
    everything = " ".join(code for _, code in inline_code())
    assert [name for name in ALLOWED if name not in everything] == []


def test_names_that_do_not_exist_are_noticed():
    assert not resolves("nvsdata.transforms.graph.RadiusGraph")
    assert not in_package("T.SumFrames")
    assert not is_file("tests/models/test_nothing.py")
    assert not is_test("test_nothing_of_the_kind")
    assert not is_class("SumFrames")
    assert not is_option("--no-such-option")
    assert not is_identifier("spline_conv_torch")


@cache
def messages():
    """The text of all strings of nvsdata, a line for each part between the fields of an f-string."""
    trees = [ast.parse(path.read_text("utf-8")) for path in sorted((ROOT / "nvsdata").rglob("*.py"))]
    strings = (node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant))
    return "\n".join(string for string in strings if isinstance(string, str))


def test_messages_of_the_troubleshooting_page_are_those_of_the_code():
    rows = re.findall(r"^\| `([^`]+)` \|", (ROOT / "docs/troubleshooting.md").read_text("utf-8"), re.MULTILINE)
    others = {"No space left on device": "of the system", "NVSDATA_CPU is ...": "of the kernels in C++"}
    others |= {row: "of torch" for row in rows if row.startswith(("default_collate: ", "stack expects "))}
    parts = {part.strip(": ") for row in rows if row not in others for part in row.split("...")} - {""}
    assert len(parts) > 15
    assert sorted(part for part in parts if part not in messages()) == []
