"""The `nvsdata verify` command: a report of damaged and missing recordings."""

from __future__ import annotations

import argparse
from collections import Counter

from nvsdata.commands.options import add_json, add_workers, dataset, path_or_url, shard
from nvsdata.common.errors import shown
from nvsdata.common.terminal import tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("root", type=path_or_url, metavar="ROOT", help="folder of recordings, or path or URL of a packed store")
    add(
        "--dataset",
        type=dataset,
        metavar="NAME",
        help="check the sensor and layout of this dataset, too (default: none)",
    )
    add_workers(add, "read")
    text = "read every N-th recording from the I-th on, for job arrays; 1/N also reports what is missing (default: all)"
    add("--shard", type=shard, metavar="I/N", help=text)
    add_json(add, "a line of JSON for each fault, and one with the result")


def run(args: argparse.Namespace) -> int:
    """Print each fault; return 1 if there is any."""
    from nvsdata.datasets.verification import problems, split_hashes

    count, counts = 0, Counter(opened=0, compared=0, guessed=0)
    how = {"jobs": args.jobs, "scheduler": args.scheduler, "shard": args.shard}
    for name, fault in problems(args.root, args.dataset, counts, **how):
        tell(f"{shown(name)}: {shown(fault)}", {"name": name, "fault": fault}, as_json=args.json)
        count += 1
    hashes = {} if args.shard else split_hashes(args.root, args.dataset)
    for split, digest in hashes.items():
        if not args.json:
            print(f"split {split}: {digest}")
    summary = {"faults": count, "splits": hashes} | counts
    done = f"{counts['opened']:,} recordings opened"
    done += f", {counts['compared']:,} compared with their manifest" if counts["compared"] else ""
    if counts["guessed"] and not args.json:
        tip = "" if args.dataset else "; --dataset NAME states it"
        why = "it is guessed from their events, so events outside the sensor aren't found"
        print(f"{counts['guessed']:,} recordings state no sensor size: {why}{tip}")
    tell(f"{done}: {f'{count} faults' if count else 'no faults'}", summary, as_json=args.json)
    return 1 if count else 0
