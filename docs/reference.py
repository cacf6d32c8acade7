"""Pages of the API reference, made from the public names: one per package, and one per family of names.

A family is what one module defines. A page has the names, signatures and docstrings, and links to pages that use them.
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import griffe
import snippets

# packages in the order of the navigation; a name belongs to the first one that has it
PACKAGES = {
    "datasets": "Datasets",
    "transforms": "Transforms",
    "models": "Networks",
    "emulation": "Emulation",
    "metrics": "Metrics",
    "formats": "Formats",
    "plots": "Plots",
    "compat": "Other libraries",
    "training": "Training",
    "": "Events, recordings, graphs and functions",
}
MOST_EXAMPLES = 4  # links of a page
FEW = 2  # a family of up to this many names has them as its title


class Family(NamedTuple):
    """Public names that a module defines.

    Args:
        group: Subpackage of the module, such as "Events"; "" if it is in the package itself.
        path: Path of the page.
        title: The names, or the module's if there are more than `FEW`.
        about: First sentence of the module's docstring.
        names: Dotted public names.
    """

    group: str
    path: str
    title: str
    about: str
    names: list[str]


class Example(NamedTuple):
    """A page of the documentation with code: path, title, code, and an image ("" if it makes none)."""

    path: str
    title: str
    code: str
    image: str


def families() -> dict[str, list[Family]]:
    """Return the families of each package in `PACKAGES`."""
    found: dict[str, list[Family]] = {}
    taken: set[int] = set()
    for package in PACKAGES:
        public = importlib.import_module(f"nvsdata.{package}".rstrip("."))
        groups: dict[str, list[str]] = {}
        for name in sorted(public.__all__, key=str.lower):
            thing = getattr(public, name)
            # names of packages, and constants, have no docstring of their own
            if (not inspect.isroutine(thing) and not isinstance(thing, type)) or id(thing) in taken:
                continue
            taken.add(id(thing))
            groups.setdefault(thing.__module__, []).append(f"{public.__name__}.{name}")
        named = [_family(package or "core", module, names) for module, names in groups.items()]
        found[package] = sorted(named, key=lambda one: (one.group, one.title.lower()))
    return found


def _family(package: str, module: str, names: list[str]) -> Family:
    stem = module.rpartition(".")[2]
    short = ", ".join(name.rpartition(".")[2] for name in names)
    title = short if len(names) <= FEW else stem.replace("_", " ").capitalize()
    about = (importlib.import_module(module).__doc__ or "").split("\n\n")[0].replace("\n", " ")
    inside = module.split(".")[2:-1] if package == "transforms" else []
    return Family(" ".join(inside).capitalize(), f"api/{package}/{stem}.md", title, about, names)


def navigation() -> list[Any]:
    """Return the part of the navigation for the reference."""
    parts: list[Any] = ["api/index.md"]
    for package, found in families().items():
        section: list[Any] = [f"api/{package or 'core'}/index.md"]
        for group, members in groupby(found, lambda one: one.group):
            named = [{one.title: one.path} for one in members]
            section += [{group: named}] if group else named
        parts.append({PACKAGES[package]: section})
    return parts


def pages(docs: Path, images: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Yield path and Markdown of all pages of the reference.

    Args:
        docs: Folder of the documentation.
        images: Path of an image by the page of the gallery that makes it.
    """
    examples = list(_examples(docs, images))
    for package, found in families().items():
        public = f"nvsdata.{package}".rstrip(".")
        lines = [f"# {PACKAGES[package]}", f"`{public}`"]
        for family in found:
            yield family.path, _page(family, examples)
            title = f"{family.group}: {family.title}" if family.group else family.title
            lines += [f"## [{title}]({Path(family.path).name})", family.about, _summary(family.names)]
        yield f"api/{package or 'core'}/index.md", "\n\n".join(lines) + "\n"


def _summary(names: list[str]) -> str:
    rows = ["| name | description |", "|---|---|"]
    for name in names:
        first = (inspect.getdoc(_object(name)) or "").split("\n\n")[0].replace("\n", " ").replace("|", "\\|")
        rows.append(f"| [`{name.rpartition('.')[2]}`][{name}] | {first} |")
    return "\n".join(rows)


def _page(family: Family, examples: list[Example]) -> str:
    parts = [f"# {family.title}", family.about]
    for name in family.names:
        parts.append(f"::: {name}")
        if inherited := _inherited(_object(name)):
            parts.append(inherited)
    short = [name.rpartition(".")[2] for name in family.names]
    using = [one for one in examples if any(re.search(rf"\b{name}\(", one.code) for name in short)]
    if using:
        parts.append("## Pages that use it" if len(short) == 1 else "## Pages that use them")
        # those with images first, which show what comes out
        using.sort(key=lambda one: not one.image)
        parts += [_link(one) for one in using[:MOST_EXAMPLES]]
    return "\n\n".join(parts) + "\n"


def _link(example: Example) -> str:
    link = f"[{example.title}](../../{example.path})"
    if not example.image:
        return link
    return f"{link}\n\n[![{example.title}](../../{example.image}){{ width=240 }}](../../{example.path})"


def _inherited(thing: Any) -> str:
    """Return a table of the parameters that a class inherits with its constructor; "" if it has its own."""
    if not isinstance(thing, type) or "Args:" in (thing.__doc__ or ""):
        return ""
    home = next((base for base in thing.__mro__[1:] if "Args:" in (base.__doc__ or "")), None)
    if home is None or not home.__module__.startswith("nvsdata.") or "__init__" in vars(thing):
        return ""
    rows = [f"Parameters inherited from `{home.__name__}`:", "| name | description |\n|---|---|"]
    with_griffe = griffe.Docstring(inspect.getdoc(home) or "")
    for section in griffe.parse_google(with_griffe, warnings=False):
        if section.kind is griffe.DocstringSectionKind.parameters:
            for one in section.value:
                rows[-1] += f"\n| `{one.name}` | {' '.join(one.description.split()).replace('|', chr(92) + '|')} |"
    return "\n\n".join(rows)


def _examples(docs: Path, images: dict[str, str]) -> Iterator[Example]:
    for folder in ("gallery", "tutorials"):
        for page in sorted((docs / folder).glob("*.md")):
            text = page.read_text("utf-8")
            code = "\n".join(block.code for block in snippets.blocks_of(text) if block.kind == "python")
            path = f"{folder}/{page.name}"
            yield Example(path, text.partition("\n")[0].lstrip("# "), code, images.get(path, ""))


def _object(name: str) -> Any:
    package, _, short = name.rpartition(".")
    module: ModuleType = importlib.import_module(package)
    return getattr(module, short)
