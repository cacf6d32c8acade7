"""The `nvsdata precompute` command: the samples of a dataset, made once and stored in one file."""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict

from nvsdata.commands.options import UsageError, add_json, add_workers, dataset, path, path_or_url, shard, usage
from nvsdata.common.errors import shown
from nvsdata.common.terminal import remark, tell

ENGINES = ("webdataset", "litdata")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("root", type=path_or_url, metavar="ROOT", help="the dataset's folder, or path or URL of a packed store of it")
    add("--dataset", required=True, type=dataset, metavar="NAME", help="name of the dataset, as in `nvsdata datasets`")
    text = 'pipeline, such as "Compose([Window(0, 30000), RadiusGraph()])"; its deterministic beginning is used'
    add("--transform", required=True, metavar="TEXT", help=text)
    add("--out", required=True, type=path, metavar="FILE.nvs", help="file to write, for `nvsdata.Precomputed`")
    add("--split", default="all", help="split whose samples are used")
    add_workers(add, "make samples")
    text = "make every N-th sample from the I-th on, into FILE-I-of-N.nvs, for `nvsdata join` (default: all)"
    add("--shard", type=shard, metavar="I/N", help=text)
    text = "also write a folder FILE-ENGINE for this library, which streams it (default: none)"
    add("--to", choices=ENGINES, help=text)
    add("--overwrite", action="store_true", help="replace FILE.nvs if it exists")
    add_json(add)


def run(args: argparse.Namespace) -> int:
    """Write the samples, and print those that are left out; return 1 if there are any."""
    from nvsdata.datasets.indexing import check_choice
    from nvsdata.datasets.precomputed import Precomputed
    from nvsdata.datasets.store.precompute import precompute
    from nvsdata.datasets.store.shards import shard_path
    from nvsdata.transforms.registry import from_repr

    if args.to and args.shard:
        raise UsageError("--to needs all samples: join the shards first, and use Precomputed.hand_over")
    kind = args.dataset
    with usage():
        check_choice("--split", args.split, kind.splits)
        try:
            transform = from_repr(args.transform)
        except TypeError as error:
            raise UsageError(f"--transform: {error}") from None
    found = kind.complete(args.root) if args.split == "all" else kind(args.root, args.split)
    found.transform = transform
    how = {name: getattr(args, name) for name in ("jobs", "scheduler", "overwrite", "shard")}
    report = precompute(found, args.out, **how)
    for name, reason in report.skipped.items():
        print(f"left out {shown(name)}: {shown(reason)}", file=sys.stderr)
    if report.tail.transforms:
        remark(f"the rest of the pipeline is for Precomputed(..., transform={report.tail!r})")
    if report.making is not None and report.reading is not None:
        worth = "" if report.reading < report.making else ": a packed store serves as well (`nvsdata pack`)"
        remark(f"making a sample takes {report.making:,.0f} µs, and reading it {report.reading:,.0f} µs{worth}")
    out = shard_path(args.out, args.shard)
    if args.to:
        Precomputed(out).hand_over(args.to, out.with_name(f"{out.stem}-{args.to}"), overwrite=args.overwrite)
    numbers = {name: value for name, value in asdict(report).items() if name not in ("head", "tail")}
    tell(
        f"{report.samples:,} samples, {report.bytes / 1e6:,.1f} MB in {shown(out)}; {len(report.skipped)} left out",
        numbers | {"out": out},
        as_json=args.json,
    )
    return 1 if report.skipped else 0
