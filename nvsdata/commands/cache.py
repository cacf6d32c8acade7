"""The `nvsdata cache` command: caches and indexes on disk, and remains of killed processes."""

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
    add("action", choices=("info", "clear"), help="show the files, or remove them; they are made again when needed")
    kinds = "folders to search for caches of samples, indexes, and remains of killed processes (default .)"
    add("folders", nargs="*", type=path, metavar="FOLDER", help=kinds)
    add_json(add, "a line of JSON for each cache, and one with the total")


def run(args: argparse.Namespace) -> int:
    """Print the caches and their sizes; with "clear", remove them."""
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
    lines.append(f"{'removed' if clear else 'total'}: {size / 1e6:,.1f} MB")
    tell("\n".join(lines), {"removed" if clear else "total": size}, as_json=args.json)
    return 0
