"""`nvsdata download`: a dataset fetched and unpacked."""

from __future__ import annotations

import argparse
from pathlib import Path

from nvsdata.commands.options import dataset, path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("dataset", metavar="NAME", type=dataset, help="as `nvsdata datasets` calls it")
    add("--root", type=path, help="the folder it goes to (default ./NAME)")


def run(args: argparse.Namespace) -> int:
    """Print the folders that the dataset is in."""
    from nvsdata.datasets.archives.download import download

    info = args.dataset.info
    for folder in download(info, args.root or Path(info.name)):
        print(folder)
    return 0
