"""`nvsdata bench`: run time against error."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from nvsdata.benchmarks import inputs
from nvsdata.benchmarks.case import Options
from nvsdata.benchmarks.line import OURS, Line, read_lines, write_lines
from nvsdata.benchmarks.page import results_page
from nvsdata.benchmarks.runner import LeftOut, measure_task
from nvsdata.benchmarks.table import comparison, work_table
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
    add("tasks", nargs="*", metavar="TASK", default=["all"], help=f"what to measure (default: all). {listed}")
    add("--quick", action="store_true", help="small sizes: all tasks take less than ten minutes on two cores")
    add("--peers", action="store_true", help="other libraries, too, as far as they are installed")
    add("--only", default="", metavar="TEXT", help="only work whose name contains this (default: all)")
    add(
        "--data",
        type=path,
        metavar="DIR",
        help="real recordings to work on (default: simulated ones)",
    )
    add("--device", default="cpu", help="of the networks, such as cuda")
    add("--json", type=path, metavar="OUT", help="file for all lines (default: none)")
    add("--html", type=path, metavar="OUT", help="file for a page with curves and tables (default: none)")
    add("--compare", type=path, metavar="OLD", help="an earlier run's --json, to compare this run with (default: none)")


def run(args: argparse.Namespace) -> int:
    """Measure, and print a table per work as soon as it is known; exit code 1 if anything of ours failed."""
    names = list(TASKS) if "all" in args.tasks else list(dict.fromkeys(args.tasks))
    if unknown := [name for name in names if name not in TASKS]:
        args.parser.error(f"unknown task {unknown[0]!r}: choose from {', '.join(TASKS)}, all")
    if args.data is not None and not args.data.is_dir():
        raise NotADirectoryError(f"{args.data}: no folder with recordings")
    # before an hour is spent
    for target in filter(None, (args.json, args.html)):
        check_place(target)
    if args.data is not None and (lacking := inputs.lacking(args.data)):
        say(f"{shown(args.data)} has no {', no '.join(lacking)}: simulated instead, or left out")
    old = read_lines(args.compare) if args.compare else []
    with tempfile.TemporaryDirectory(prefix="nvsdata-bench-") as scratch:
        options = Options(Path(scratch), args.quick, args.device, args.data)
        lines, failed = _measure(names, options, args)
    if not lines:
        raise ValueError("all failed" if failed else f"nothing was measured: no work's name contains {args.only!r}")
    if old:
        print(comparison(lines, old))
    for target in filter(None, (args.json, args.html)):
        say(f"written: {shown(target)}")
    return 1 if failed else 0


def _measure(names: list[str], options: Options, args: argparse.Namespace) -> tuple[list[Line], bool]:
    lines: list[Line] = []
    failed = False
    for name in names:
        group: list[Line] = []
        for found in measure_task(name, options, peers=args.peers, wanted=lambda case: args.only in case.work):
            if isinstance(found, LeftOut):
                failed |= found.failed and found.case.library == OURS
                say(f"{found.case.task}: {found.case.work}: {found.case.library} is left out: {shown(found.reason)}")
                continue
            if group and group[-1].work != found.work:
                print(work_table(group), end="\n\n", flush=True)
                group = []
            group.append(found)
            lines.append(found)
        if group:
            print(work_table(group), end="\n\n", flush=True)
        # after each task, so that a run that is stopped leaves what it found
        if args.json and lines:
            write_lines(lines, args.json)
        if args.html and lines:
            put(args.html, results_page(lines).encode(), through_link=True)
    return lines, failed
