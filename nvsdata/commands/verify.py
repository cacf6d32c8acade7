"""`nvsdata verify`: what is wrong with recordings, and what is lacking."""

from __future__ import annotations

import argparse
from collections import Counter

from nvsdata.commands.options import add_json, dataset, path
from nvsdata.common.errors import shown
from nvsdata.common.terminal import tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("root", type=path, metavar="ROOT", help="a folder or a packed store")
    add("--dataset", type=dataset, metavar="NAME", help="dataset whose sensor and layout ROOT must have (default: any)")
    add_json(add, "a line of JSON per fault, and one at the end")


def run(args: argparse.Namespace) -> int:
    """Print each fault; return 1 if there is any."""
    from nvsdata.datasets.verification import problems, split_hashes

    count, counts = 0, Counter(opened=0, compared=0)
    for name, fault in problems(args.root, args.dataset, counts):
        tell(f"{shown(name)}: {shown(fault)}", {"name": name, "fault": fault}, as_json=args.json)
        count += 1
    hashes = split_hashes(args.root, args.dataset)
    for split, digest in hashes.items():
        if not args.json:
            print(f"split {split}: {digest}")
    summary = {"faults": count, "splits": hashes} | counts
    done = f"{counts['opened']:,} recordings opened"
    done += f", {counts['compared']:,} compared with their manifest" if counts["compared"] else ""
    tell(f"{done}: {f'{count} faults' if count else 'all sound'}", summary, as_json=args.json)
    return 1 if count else 0
