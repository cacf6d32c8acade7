"""The `nvsdata bench` command: run time against error."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from nvsdata.benchmarks import inputs
from nvsdata.benchmarks.case import Options
from nvsdata.benchmarks.measurement import OURS, Measurement, read_measurements, write_measurements
from nvsdata.benchmarks.page import benchmark_page
from nvsdata.benchmarks.runner import SkippedCase, measure_task
from nvsdata.benchmarks.table import benchmark_table, comparison
from nvsdata.benchmarks.tasks import TASKS
from nvsdata.commands.options import path
from nvsdata.common.errors import shown
from nvsdata.common.files import put
from nvsdata.common.locks import check_place
from nvsdata.common.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    listed = "; ".join(f"{name}: {what}" for name, what in TASKS.items())
    add("tasks", nargs="*", metavar="TASK", default=["all"], help=f"tasks to measure (default: all). {listed}")
    add("--quick", action="store_true", help="small sizes: all tasks take less than ten minutes on two cores")
    add("--peers", action="store_true", help="measure other libraries that are installed, too")
    add("--only", default="", metavar="TEXT", help="only benchmarks whose name contains this (default: all)")
    add(
        "--data",
        type=path,
        metavar="DIR",
        help="folder with real recordings and videos (default: synthetic ones)",
    )
    add("--device", default="cpu", help="device of torch for networks, such as cuda")
    add("--json", type=path, metavar="OUT", help="write all measurements to this file, for --compare (default: none)")
    add("--html", type=path, metavar="OUT", help="write a page with charts and tables to this file (default: none)")
    add("--compare", type=path, metavar="OLD", help="compare with the --json file of an earlier run (default: none)")


def run(args: argparse.Namespace) -> int:
    """Measure, and print a table after each benchmark; return 1 if a case of nvsdata failed."""
    names = list(TASKS) if "all" in args.tasks else list(dict.fromkeys(args.tasks))
    if unknown := [name for name in names if name not in TASKS]:
        args.parser.error(f"unknown task {unknown[0]!r}: choose from {', '.join(TASKS)}, all")
    if args.data is not None and not args.data.is_dir():
        raise NotADirectoryError(f"{args.data}: no such folder; --data needs a folder with recordings")
    # fail now rather than after an hour
    for target in filter(None, (args.json, args.html)):
        check_place(target)
    if args.data is not None and (missing := inputs.missing_recordings(args.data)):
        say(f"{shown(args.data)} has no {', no '.join(missing)}: these benchmarks use synthetic data or are skipped")
    old = read_measurements(args.compare) if args.compare else []
    with tempfile.TemporaryDirectory(prefix="nvsdata-bench-") as scratch:
        options = Options(Path(scratch), args.quick, args.device, args.data)
        measurements, failed = _measure(names, options, args)
    if not measurements:
        raise ValueError(
            "all benchmarks failed" if failed else f"nothing was measured: no benchmark's name contains {args.only!r}"
        )
    if old:
        print(comparison(measurements, old))
    for target in filter(None, (args.json, args.html)):
        say(f"written: {shown(target)}")
    return 1 if failed else 0


def _measure(names: list[str], options: Options, args: argparse.Namespace) -> tuple[list[Measurement], bool]:
    measurements: list[Measurement] = []
    failed = False
    for name in names:
        group: list[Measurement] = []
        for found in measure_task(name, options, peers=args.peers, wanted=lambda case: args.only in case.benchmark):
            if isinstance(found, SkippedCase):
                failed |= found.failed and found.case.library == OURS
                say(
                    f"{found.case.task}: {found.case.benchmark}: {found.case.library} is skipped: {shown(found.reason)}"
                )
                continue
            if group and group[-1].benchmark != found.benchmark:
                print(benchmark_table(group), end="\n\n", flush=True)
                group = []
            group.append(found)
            measurements.append(found)
        if group:
            print(benchmark_table(group), end="\n\n", flush=True)
        # after each task, so that an interrupted run keeps its results
        if args.json and measurements:
            write_measurements(measurements, args.json)
        if args.html and measurements:
            put(args.html, benchmark_page(measurements).encode(), through_link=True)
    return measurements, failed
