"""The `nvsdata join` command: one store of shards that were packed on their own."""

from __future__ import annotations

import argparse

from nvsdata.commands.options import add_json, path
from nvsdata.common.errors import shown
from nvsdata.common.terminal import tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("shards", nargs="+", type=path, metavar="SHARD", help="all shards of a store, such as asl-*-of-8.nvs")
    add("--out", required=True, type=path, metavar="FILE.nvs", help="index file to write, in the folder of the shards")
    add("--overwrite", action="store_true", help="replace FILE.nvs if it exists")
    add_json(add)


def run(args: argparse.Namespace) -> int:
    """Write the index file."""
    from nvsdata.datasets.store.joining import join

    count = join(args.shards, args.out, overwrite=args.overwrite)
    tell(
        f"{count:,} recordings of {len(args.shards):,} shards in {shown(args.out)}",
        {"recordings": count, "shards": len(args.shards), "out": args.out},
        as_json=args.json,
    )
    return 0
