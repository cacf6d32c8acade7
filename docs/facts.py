"""Tables made from the registries (datasets, transforms, commands, formats) and from measurements."""

from __future__ import annotations

import argparse
import inspect
from importlib import import_module
from urllib.parse import urlsplit

import figures

from nvsdata import transforms
from nvsdata.cli import COMMANDS
from nvsdata.datasets import DATASETS
from nvsdata.formats import FORMATS


def table(name: str) -> str:
    """Return a table in Markdown by its name; "dataset n-mnist" and the like is that of one dataset."""
    kind, _, rest = name.partition(" ")
    tables = {
        "datasets": _datasets,
        "transforms": _transforms,
        "commands": _commands,
        "formats": _formats,
        "comparison": lambda: _rows(*figures.comparison()),
        "growth": lambda: _rows(*figures.growth()),
        "ablation": lambda: _rows(*figures.ablation(rest)),
        "accuracy": lambda: _rows(*figures.accuracy(rest)),
    }
    return tables.get(kind, lambda: _dataset(rest))()


def _rows(*rows: tuple[str, ...]) -> str:
    head, *others = rows
    lines = [head, tuple("---" for _ in head), *others]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _size(info) -> str:
    size = sum(archive.size for archive in info.archives)
    return f"{size / 1e9:.1f} GB" if size else "unknown"


def _hosts(info) -> str:
    """Return the hosts of the archives, and the number of known hashes."""
    hosts = dict.fromkeys(urlsplit(url).hostname for archive in info.archives for url in archive.urls)
    hashed = sum(bool(archive.hash) for archive in info.archives)
    known = "" if not info.archives else f"; {hashed} of {len(info.archives)} hashes known"
    return (", ".join(hosts) or "manual download only") + known


def _datasets() -> str:
    rows = [("dataset", "recordings", "classes", "sensor", "download", "license", "how to get it")]
    for name, kind in DATASETS.items():
        if name == "folder":
            continue
        info = kind.info
        sensor = "{}x{}".format(*info.sensor_size) if info.sensor_size else "varies"
        how = "`nvsdata download`" if info.by_program else f"[manual download]({info.page})"
        page = f"[{kind.__name__}]({name}.md)"
        rows.append((page, f"{info.recordings:,}", str(len(info.classes)), sensor, _size(info), info.license, how))
    return _rows(*rows)


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
        rows.append((f"[`T.{name}`](api/transforms.md#nvsdata.transforms.{name})", first, same))
    return _rows(*rows)


def _commands() -> str:
    parts = []
    for name, command in COMMANDS.items():
        parser = argparse.ArgumentParser(prog=f"nvsdata {name}", add_help=False)
        import_module(f"nvsdata.commands.{command.module}").add_arguments(parser)
        usage = parser.format_usage().removeprefix("usage: ")
        parts.append(f"## nvsdata {name}\n\n{command.help[0].upper()}{command.help[1:]}.\n\n```text\n{usage}```\n")
        rows = [("option", "what it does")]
        for action in parser._actions:
            flags = ", ".join(f"`{flag}`" for flag in action.option_strings) or f"`{action.metavar or action.dest}`"
            rows.append((flags, (action.help or "").replace("%(default)s", str(action.default)).replace("%%", "%")))
        parts.append(_rows(*rows))
    return "\n\n".join(parts)


def _formats() -> str:
    rows = [("name", "extensions", "written", "frames and inertial samples")]
    for name in sorted(FORMATS):
        one = FORMATS[name]
        writes = "yes" if one.write is not None else ""
        rows.append((name, ", ".join(f"`{s}`" for s in one.suffixes), writes, "yes" if one.holds_samples else ""))
    return _rows(*rows)
