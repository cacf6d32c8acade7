"""Tables made from the registries (datasets, transforms, commands, formats) and from measurements.

`python docs/facts.py` writes them into the pages.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from importlib import import_module
from pathlib import Path
from urllib.parse import urlsplit

import dataset_pictures
import figures

from nvsdata import transforms
from nvsdata.cli import COMMANDS
from nvsdata.datasets import DATASETS
from nvsdata.formats import FORMATS

DOCS = Path(__file__).parent
MARK = re.compile(r"<!-- table: ([\w. -]+) -->\n(?:(?:(?!<!--).*\n)*<!-- end of table -->\n)?")
ONLY_ON_SITE = ("gallery",)  # it is made of images that the site's build draws


def with_tables(text: str) -> str:
    """Return a page as it stands in the repository: with its tables, but for what only the site can show."""

    def written(found: re.Match[str]) -> str:
        if found[1] in ONLY_ON_SITE:
            return found[0]
        plain = re.sub(r"<br>!\[\]\([^)]*\)\{[^}]*\}", "", table(found[1]))
        plain = re.sub(r"\[(`[^`]+`)\]\[[\w.]+\]", r"\1", plain)
        return f"<!-- table: {found[1]} -->\n\n{plain}\n\n<!-- end of table -->\n"

    return MARK.sub(written, text)


def table(name: str) -> str:
    """Return a table in Markdown by its name; "dataset n-mnist" and the like is that of one dataset."""
    kind, _, rest = name.partition(" ")
    tables = {
        "datasets": _datasets,
        "transforms": _transforms,
        "commands": _commands,
        "formats": _formats,
        "gallery": _gallery,
        "comparison": lambda: _rows(*figures.comparison()),
        "growth": lambda: _rows(*figures.growth()),
        "ablation": lambda: _rows(*figures.ablation(rest)),
        "robustness": lambda: _rows(*figures.robustness()),
        "thesis-commands": _thesis_commands,
        "accuracy": lambda: _rows(*figures.accuracy(rest)),
    }
    return tables.get(kind, lambda: _dataset(rest))()


def _rows(*rows: tuple[str, ...]) -> str:
    head, *others = rows
    lines = [head, tuple("---" for _ in head), *others]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _size(info) -> str:
    # an archive within another one comes with the whole
    size = sum({whole.name: whole.size for whole in (archive.within or archive for archive in info.archives)}.values())
    return f"{size / 1e9:.1f} GB" if size else info.reported_size or "unknown"


def _hosts(info) -> str:
    """Return the hosts of the archives, and the number of known hashes."""
    hosts = dict.fromkeys(urlsplit(url).hostname for archive in info.archives for url in archive.urls)
    hashed = sum(bool(archive.hash) for archive in info.archives)
    known = "" if not info.archives else f"; {hashed} of {len(info.archives)} hashes known"
    return (", ".join(hosts) or "manual download only") + known


def _datasets() -> str:
    rows = [("dataset", "recordings", "classes", "sensor", "size", "license", "download")]
    for name, kind in DATASETS.items():
        if name == "folder":
            continue
        info = kind.info
        sensor = "{}x{}".format(*info.sensor_size) if info.sensor_size else "varies"
        how = "command" if info.by_program else f"[manual]({info.page})"
        shown = f"[{kind.__name__}{_image(name)}]({name}.md)"
        rows.append((shown, f"{info.recordings:,}", f"{len(info.classes)}", sensor, _size(info), info.license, how))
    return _rows(*rows)


def _image(name: str) -> str:
    """Return the image of a dataset in the table; "" if the repository has none, and none can be drawn here."""
    if (DOCS / f"datasets/{name}.png").exists():
        image = f"{name}.png"
    elif dataset_pictures.thumbnail(name):
        image = f"{name}-small.png"
    else:
        return ""
    return f"<br>![]({image}){{ .on-white width=90 }}"


def _dataset(name: str) -> str:
    kind = DATASETS[name]
    info = kind.info
    sensor = "{}x{} pixels".format(*info.sensor_size) if info.sensor_size else "differs by recording"
    rows = [
        ("fact", "value"),
        ("class", f"`nvsdata.{kind.__name__}`"),
        ("recordings", f"{info.recordings:,}" + (f" ({info.known_from})" if info.known_from else "")),
        ("classes", f"{len(info.classes)}"),
        ("sensor", sensor),
        ("splits", ", ".join(f"`{split}`" for split in kind.splits)),
        ("layout below `root`", f"`{info.tree}`"),
        ("license", info.license),
        ("download", f"{_size(info)}; " + (f"`nvsdata download {name}`" if info.by_program else "manual download")),
        ("hosts", _hosts(info)),
        ("web page", f"<{info.page}>"),
    ]
    return _rows(*rows)


def _transforms() -> str:
    rows = [("transform", "description", "deterministic")]
    for name in sorted(transforms.TRANSFORMS):
        kind = transforms.TRANSFORMS[name]
        first = (inspect.getdoc(kind) or "").split("\n")[0]
        same = "yes" if getattr(kind, "deterministic", False) else "no"
        rows.append((f"[`T.{name}`][nvsdata.transforms.{name}]", first, same))
    return _rows(*rows)


def _narrow(prog: str) -> argparse.HelpFormatter:
    """Format usages in the same way in every terminal."""
    return argparse.HelpFormatter(prog, width=100)


def _commands() -> str:
    parts = []
    for name, command in COMMANDS.items():
        parser = argparse.ArgumentParser(prog=f"nvsdata {name}", add_help=False, formatter_class=_narrow)
        import_module(f"nvsdata.commands.{command.module}").add_arguments(parser)
        usage = parser.format_usage().removeprefix("usage: ")
        parts.append(f"## nvsdata {name}\n\n{command.help[0].upper()}{command.help[1:]}.\n\n```text\n{usage}```\n")
        rows = [("option", "what it does")]
        for action in parser._actions:
            flags = ", ".join(f"`{flag}`" for flag in action.option_strings) or f"`{action.metavar or action.dest}`"
            rows.append((flags, (action.help or "").replace("%(default)s", str(action.default)).replace("%%", "%")))
        parts.append(_rows(*rows))
    return "\n\n".join(parts)


def _gallery() -> str:
    rows = [("", "page", "")]
    for page in sorted((DOCS / "gallery").glob("*.md")):
        if page.stem != "index":
            title, about, rest = page.read_text("utf-8").split("\n\n", 2)
            title, first = title.lstrip("# "), re.split(r"(?<! al)\. ", about.replace("\n", " "))[0].rstrip(".")
            drawn = re.search(r"!\[[^]]*\]\(([\w-]+\.png)\)", rest)
            image = f"[![]({drawn[1]}){{ width=150 }}]({page.name})" if drawn else ""
            rows.append((image, f"[{title}]({page.name})", f"{first}."))
    return _rows(*rows)


def _formats() -> str:
    rows = [("name", "extensions", "written", "frames and inertial samples")]
    for name in sorted(FORMATS):
        one = FORMATS[name]
        writes = "yes" if one.write is not None else ""
        rows.append((name, ", ".join(f"`{s}`" for s in one.suffixes), writes, "yes" if one.holds_samples else ""))
    return _rows(*rows)


def _thesis_commands() -> str:
    """Return the commands that repeat tables of the thesis."""
    sys.path.insert(0, str(DOCS.parent / "recipes"))
    tables = import_module("thesis_tables").TABLES
    found = {number: [command.line for command in table.commands] for number, table in tables.items()}
    lines = [line for number, commands in found.items() if commands for line in (f"# {number}", *commands)]
    return "\n".join(("```text", *lines, "```"))


if __name__ == "__main__":
    for page in DOCS.rglob("*.md"):
        if (made := with_tables(before := page.read_text("utf-8"))) != before:
            page.write_text(made, "utf-8", newline="\n")
