"""`nvsdata convert-videos`: videos to events."""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import asdict, replace
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
    add("--out", type=path, metavar="DIR", help="the folder that recordings go to (default IN-events)")
    add_videos(add)
    add("--size", type=sensor_size, metavar="WxH", help="pixels that frames are scaled to (default: as they are)")
    add("--fps", type=positive, help="frames per second, whatever the files say (default: as they say)")
    add("--fit", choices=get_args(FitMode), default="pad", help="frames of another shape: whole, filling, or distorted")
    add("--crop", type=int, nargs=4, metavar=("X", "Y", "WIDTH", "HEIGHT"), help="pixels of the frames (default: all)")
    add("--start", type=not_negative, default=0.0, metavar="S", help="from this second on")
    add("--stop", type=positive, default=math.inf, metavar="S", help="up to this second (default: end)")
    # one process decodes, emulates and writes in three threads, which keep two cores busy
    add_jobs(add, "processes (default: one for every two cores)", max(1, cores() // 2))
    share = "do the I-th of N parts of the videos, as in job arrays; all write to the same DIR (default: all)"
    add("--shard", type=shard, metavar="I/N", help=share)
    add("--scheduler", metavar="ADDRESS", help="have the Dask cluster at this address do it")
    add("--preview", action="store_true", help="write films of the first minute, with events, to DIR/.previews")
    add("--dry-run", action="store_true", help="say what would be done, and about how long and how large it is")
    add("--overwrite", action="store_true", help="convert all anew, also what was made with other settings")
    add(
        "--check",
        action="store_true",
        help="compare recordings in DIR with their sha256, convert again if changed",
    )
    add_json(add)
    add_settings(parser)


def run(args: argparse.Namespace) -> int:
    """Convert what isn't there yet: 1 if any video failed."""
    from nvsdata.emulation.convert import convert_videos, default_out, plan
    from nvsdata.emulation.estimate import estimate_conversion
    from nvsdata.emulation.preview import FOLDER

    # threads that decode, emulate and write must pass Python's lock on in less than a frame's time
    sys.setswitchinterval(0.0005)
    settings = emulator_from(args)
    chosen = {"format": args.format, "size": args.size, "fps": args.fps, "limit": args.limit, "shard": args.shard}
    if args.shard and args.overwrite:
        raise UsageError("--overwrite goes without --shard: others may have made what a shard overwrites")
    with usage():
        chosen["view"] = VideoView(args.start, args.stop, args.crop and tuple(args.crop), args.fit)
    out = args.out or default_out(args.source)
    if args.dry_run:
        jobs = plan(args.source, args.out, settings, **chosen)
        if not args.json:
            for job in jobs:
                print(f"{shown(job.video.path)} -> {shown(job.video.target)}")
            print(settings)
        found = estimate_conversion(jobs, out)
        found = replace(found, seconds=found.seconds / max(1, min(args.jobs, len(jobs))))
        tell(str(found), asdict(found), as_json=args.json)
        return 0
    how = {name: getattr(args, name) for name in ("jobs", "scheduler", "overwrite", "check", "preview")}
    report = convert_videos(args.source, args.out, settings, **how, **chosen)
    for line in report.told():
        print(line, file=sys.stderr)
    if args.preview:
        remark(f"previews are in {shown(out / FOLDER)}")
    done = f"{report.done:,} converted, {report.kept:,} were there, {len(report.failed):,} failed"
    there = f"{report.total}{' of shard {}/{}'.format(*args.shard) if args.shard else ''} in {shown(out)}"
    text = f"{done}; {report.events:,} events converted, {there}"
    tell(text, asdict(report) | {"out": out}, as_json=args.json)
    return 1 if report.failed else 0
