"""`nvsdata verify`: what is wrong with recordings, and what is lacking."""

from __future__ import annotations

import argparse

from nvsdata.commands.options import dataset, path
from nvsdata.common.errors import shown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("root", type=path, metavar="ROOT", help="a folder or a packed store")
    add("--dataset", type=dataset, metavar="NAME", help="dataset whose sensor and layout ROOT must have (default: any)")


def run(args: argparse.Namespace) -> int:
    """Print each fault; return 1 if there is any."""
    from nvsdata.datasets.verification import problems

    count = 0
    for name, fault in problems(args.root, args.dataset):
        print(f"{shown(name)}: {fault}")
        count += 1
    print("all sound" if not count else f"{count} faults")
    return 1 if count else 0
