"""The `nvsdata push` command: packed stores and a dataset card on a remote file system."""

from __future__ import annotations

import argparse

from nvsdata.commands.options import add_json, path
from nvsdata.common.terminal import tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add(
        "stores",
        nargs="+",
        type=path,
        metavar="FILE.nvs",
        help="packed store; of an index file, its shards are sent, too",
    )
    add("url", metavar="URL", help="folder that gets the files, such as hf://datasets/USER/NAME or s3://BUCKET/FOLDER")
    add("--overwrite", action="store_true", help="replace other files with these names, and README.md")
    add_json(add)


def run(args: argparse.Namespace) -> int:
    """Send the files that aren't there."""
    from nvsdata.datasets.store.pushing import push
    from nvsdata.remote.url import Url

    done = push(args.stores, args.url, overwrite=args.overwrite)
    where = str(Url(args.url))
    tell(
        f"{len(done.sent):,} files sent to {where}, {len(done.kept):,} were there",
        {"sent": done.sent, "kept": done.kept, "url": where},
        as_json=args.json,
    )
    return 0
