"""`nvsdata pack`: all recordings of a dataset in one file."""

from __future__ import annotations

import argparse
import sys

from nvsdata.commands.options import add_jobs, dataset, path, usage
from nvsdata.common.errors import shown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("root", type=path, metavar="ROOT", help="the dataset's folder")
    add("--dataset", required=True, type=dataset, metavar="NAME", help="as `nvsdata datasets` calls it, or folder")
    add("--out", required=True, type=path, metavar="FILE.h5", help="the store that is written")
    add("--split", default="all", help="pack one split only; a store of all gives any split")
    add_jobs(add, "processes that decode")
    add("--compress", action="store_true", help="smaller, but slower to read")
    add("--overwrite", action="store_true", help="replace FILE.h5 if it is there")


def run(args: argparse.Namespace) -> int:
    """Pack, and say what was left out: 1 if anything was."""
    from nvsdata.datasets.indexing import check_choice
    from nvsdata.datasets.store.writer import pack

    kind = args.dataset
    with usage():
        check_choice("--split", args.split, kind.splits)
    found = kind.whole(args.root) if args.split == "all" else kind(args.root, args.split)
    report = pack(found, args.out, jobs=args.jobs, compress=args.compress, overwrite=args.overwrite)
    for name, reason in report.skipped.items():
        print(f"left out {shown(name)}: {reason}", file=sys.stderr)
    print(f"{report.packed:,} recordings, {report.events:,} events in {args.out}; {len(report.skipped)} left out")
    return 1 if report.skipped else 0
