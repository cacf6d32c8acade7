"""The `nvsdata pack` command: all recordings of a dataset in one file."""

from __future__ import annotations

import argparse
import shutil
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from nvsdata.commands.options import add_json, add_workers, dataset, path, shard, usage
from nvsdata.common.errors import shown
from nvsdata.common.terminal import tell

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from nvsdata.datasets.base import EventDataset

BYTES = 9  # bytes of an event in a store
SAMPLED = 50  # recordings whose events are counted for an estimate


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("root", type=path, metavar="ROOT", help="the dataset's folder")
    add(
        "--dataset",
        required=True,
        type=dataset,
        metavar="NAME",
        help='name of the dataset, as in `nvsdata datasets`, or "folder" for folders with a class each',
    )
    add("--out", required=True, type=path, metavar="FILE.nvs", help="packed store to write")
    add("--split", default="all", help="pack one split only; a store of all recordings contains every split")
    add_workers(add, "decode")
    add("--compress", action="store_true", help="compress the store: smaller, but slower to read")
    add(
        "--shard",
        type=shard,
        metavar="I/N",
        help="pack every N-th recording from the I-th on, into FILE-I-of-N.nvs, for `nvsdata join` (default: all)",
    )
    add("--overwrite", action="store_true", help="replace FILE.nvs if it exists")
    add(
        "--dry-run",
        action="store_true",
        help="print the number of recordings and the approximate size, and write nothing",
    )
    add_json(add)


def _plan(found: EventDataset, args: argparse.Namespace, out: Path) -> None:
    """Print the number of recordings, their size and the approximate size of the store `out`."""
    from nvsdata.batch.scheduler import in_shard

    names = in_shard(found.recording_names(), args.shard)
    size = sum(found.source.size(name) for name in names)
    events, read = count_sample(found, names)
    needed = round(events * BYTES * size / max(read, 1))
    free = shutil.disk_usage(out.absolute().parent).free
    tell(
        f"{len(names):,} recordings, {size / 1e9:,.2f} GB; about {needed / 1e9:,.2f} GB in {shown(out)}"
        f"{' at most' if args.compress else ''}, where {free / 1e9:,.1f} GB are free",
        {"recordings": len(names), "bytes": size, "needed": needed, "free": free},
        as_json=args.json,
    )


def count_sample(found: EventDataset, names: Sequence[str]) -> tuple[int, int]:
    """Count the events of up to 50 recordings, and the bytes of their files."""
    some = [names[n * len(names) // SAMPLED] for n in range(min(SAMPLED, len(names)))] if names else []
    events = read = 0
    for name in dict.fromkeys(some):
        with suppress(OSError, ValueError):
            events += len(found.open_recording(name).read())
            read += found.source.size(name)
    return events, read


def run(args: argparse.Namespace) -> int:
    """Pack the recordings, and print those that are left out; return 1 if there are any."""
    from nvsdata.datasets.indexing import check_choice
    from nvsdata.datasets.store.shards import shard_path
    from nvsdata.datasets.store.writer import pack

    kind = args.dataset
    with usage():
        check_choice("--split", args.split, kind.splits)
    found = kind.complete(args.root) if args.split == "all" else kind(args.root, args.split)
    out = shard_path(args.out, args.shard)
    if args.dry_run:
        _plan(found, args, out)
        return 0
    how = {name: getattr(args, name) for name in ("jobs", "scheduler", "compress", "overwrite", "shard")}
    report = pack(found, args.out, **how)
    for name, reason in report.skipped.items():
        print(f"left out {shown(name)}: {shown(reason)}", file=sys.stderr)
    tell(
        f"{report.packed:,} recordings, {report.events:,} events in {shown(out)}; {len(report.skipped)} left out",
        {"packed": report.packed, "events": report.events, "out": out, "left_out": report.skipped},
        as_json=args.json,
    )
    return 1 if report.skipped else 0
