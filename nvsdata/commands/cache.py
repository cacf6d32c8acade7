"""`nvsdata cache`: what nvsdata keeps on disk to be faster."""

from __future__ import annotations

import argparse
from pathlib import Path

from nvsdata.commands.options import add_json, path
from nvsdata.common.errors import shown
from nvsdata.common.terminal import tell
from nvsdata.common.text import aligned


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("action", choices=("info", "clear"), help="say what there is, or remove it: it is made again when it is needed")
    kinds = "folders to look through: caches of samples, indexes, what killed processes left (default .)"
    add("folders", nargs="*", type=path, metavar="FOLDER", help=kinds)
    add_json(add, "a line of JSON per cache, and one at the end")


def run(args: argparse.Namespace) -> int:
    """Print what there is; with "clear", remove it."""
    from nvsdata.datasets.cache.cleanup import kept_below, remove_kept

    found = [one for folder in args.folders or [Path()] for one in kept_below(folder)]
    clear = args.action == "clear"
    for one in found:
        if args.json:
            tell("", {"kind": one.kind, "path": one.path, "files": len(one.files), "bytes": one.bytes}, as_json=True)
        if clear:
            remove_kept(one)
    size = sum(one.bytes for one in found)
    rows = [(one.kind, shown(one.path), f"{len(one.files):,} files", f"{one.bytes / 1e6:,.1f} MB") for one in found]
    lines = [aligned(rows, left=True)] if rows else []
    lines.append(f"{'removed' if clear else 'in all'}: {size / 1e6:,.1f} MB")
    tell("\n".join(lines), {"removed" if clear else "in_all": size}, as_json=args.json)
    return 0
