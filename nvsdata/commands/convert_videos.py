"""`nvsdata convert-videos`: convert videos to events."""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import asdict
from typing import get_args

from nvsdata.commands.emulation_settings import add_settings, emulator_from
from nvsdata.commands.options import (
    UsageError,
    add_jobs,
    add_json,
    add_videos,
    not_negative,
    path,
    positive,
    sensor_size,
    shard,
    usage,
)
from nvsdata.common.errors import shown
from nvsdata.common.processes import cores
from nvsdata.common.terminal import remark, tell
from nvsdata.video.view import FitMode, VideoView


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("source", type=path, metavar="IN", help="a folder of videos, or one video")
    add("--out", type=path, metavar="DIR", help="folder of the recordings (default IN-events)")
    add_videos(add)
    add("--size", type=sensor_size, metavar="WxH", help="size in pixels that frames are scaled to (default: unchanged)")
    add("--fps", type=positive, help="frames per second, in place of the files' own times (default: the files')")
    text = "frames of another shape: pad with black, crop what is outside, or stretch"
    add("--fit", choices=get_args(FitMode), default="pad", help=text)
    text = "part of the frames in pixels (default: all of each)"
    add("--crop", type=int, nargs=4, metavar=("X", "Y", "WIDTH", "HEIGHT"), help=text)
    add("--start", type=not_negative, default=0.0, metavar="S", help="second of each video to begin at")
    add("--stop", type=positive, default=math.inf, metavar="S", help="second of each video to end at (default: end)")
    # one process decodes, emulates and writes in three threads, which keep two cores busy
    add_jobs(add, "processes (default: one for every two cores)", max(1, cores() // 2))
    text = "convert the I-th of N parts of the videos, for job arrays; all parts use the same DIR (default: all)"
    add("--shard", type=shard, metavar="I/N", help=text)
    add("--scheduler", metavar="ADDRESS", help="convert on the Dask cluster at this address")
    add(
        "--preview",
        action="store_true",
        help="write a film of each video's first minute with its events to DIR/.previews",
    )
    add("--dry-run", action="store_true", help="print what would be done, with an estimate of time and disk")
    add("--overwrite", action="store_true", help="convert all again, also recordings made with other settings")
    text = "compare recordings in DIR with their sha256, and convert again those that changed"
    add("--check", action="store_true", help=text)
    add_json(add)
    add_settings(parser)


def run(args: argparse.Namespace) -> int:
    """Convert the videos that have no recording yet; return 1 if any failed."""
    from nvsdata.emulation.convert import convert_videos, default_out, plan
    from nvsdata.emulation.estimate import estimate_conversion
    from nvsdata.emulation.preview import FOLDER

    # the threads that decode, emulate and write must get Python's lock within a frame's time
    sys.setswitchinterval(0.0005)
    settings = emulator_from(args)
    chosen = {"format": args.format, "size": args.size, "fps": args.fps, "limit": args.limit, "shard": args.shard}
    if args.shard and args.overwrite:
        raise UsageError("--overwrite doesn't go with --shard: other shards may have made the recordings")
    with usage():
        chosen["view"] = VideoView(args.start, args.stop, args.crop and tuple(args.crop), args.fit)
    out = args.out or default_out(args.source)
    if args.dry_run:
        jobs = plan(args.source, args.out, settings, **chosen)
        if not args.json:
            for job in jobs:
                print(f"{shown(job.video.path)} -> {shown(job.video.target)}")
            print(settings)
        expected = estimate_conversion(jobs, out, args.jobs)
        tell(str(expected), asdict(expected), as_json=args.json)
        return 0
    how = {name: getattr(args, name) for name in ("jobs", "scheduler", "overwrite", "check", "preview")}
    report = convert_videos(args.source, args.out, settings, **how, **chosen)
    for line in report.messages():
        print(line, file=sys.stderr)
    if args.preview:
        remark(f"previews are in {shown(out / FOLDER)}")
    done = f"{report.done:,} converted, {report.kept:,} already existed, {len(report.failed):,} failed"
    there = f"{report.total}{' of shard {}/{}'.format(*args.shard) if args.shard else ''} in {shown(out)}"
    text = f"{done}; {report.events:,} events converted, {there}"
    tell(text, asdict(report) | {"out": out}, as_json=args.json)
    return 1 if report.failed else 0
