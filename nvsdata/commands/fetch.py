"""The `nvsdata fetch` command: a copy of a remote store."""

from __future__ import annotations

import argparse

from nvsdata.commands.options import add_json, path
from nvsdata.common.errors import shown
from nvsdata.common.terminal import tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("url", metavar="URL", help="packed store, or the index file of joined shards, such as s3://BUCKET/FILE.nvs")
    add("--out", required=True, type=path, metavar="DIR", help="folder that gets the files, made if needed")
    add("--overwrite", action="store_true", help="replace other files with these names")
    add_json(add)


def run(args: argparse.Namespace) -> int:
    """Copy the files that aren't there."""
    from nvsdata.datasets.store.fetching import fetch

    copied = fetch(args.url, args.out, overwrite=args.overwrite)
    size = sum(file.stat().st_size for file in copied)
    tell(
        f"{len(copied):,} files, {size / 1e6:,.1f} MB, in {shown(args.out)}: checked",
        {"files": copied, "bytes": size},
        as_json=args.json,
    )
    return 0
