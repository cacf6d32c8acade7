"""`nvsdata convert-videos`: videos to events."""

from __future__ import annotations

import argparse
import sys

from nvsdata.commands.emulation_settings import add_settings, settings_of
from nvsdata.commands.options import add_jobs, add_videos, path, positive, sensor_size


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("source", type=path, metavar="IN", help="a folder of videos, or one video")
    add("--out", type=path, metavar="DIR", help="the folder that recordings go to (default IN-events)")
    add_videos(add)
    add("--size", type=sensor_size, metavar="WxH", help="pixels that frames are scaled to (default: as they are)")
    add("--fps", type=positive, help="frames per second, whatever the files say (default: as they say)")
    add_jobs(add, "processes")
    add("--scheduler", metavar="ADDRESS", help="have the Dask cluster at this address do it")
    add("--dry-run", action="store_true", help="say what would be done")
    add_settings(parser)


def run(args: argparse.Namespace) -> int:
    """Convert what isn't there yet: 1 if any video failed."""
    from nvsdata.emulation.convert import convert_videos, default_out, plan

    # threads that decode, emulate and write must pass Python's lock on in less than a frame's time
    sys.setswitchinterval(0.0005)
    settings = settings_of(args)
    chosen = {"format": args.format, "size": args.size, "fps": args.fps, "limit": args.limit}
    if args.dry_run:
        for job in plan(args.source, args.out, settings, **chosen):
            print(f"{job.video.path} -> {job.video.target}")
        print(settings)
        return 0
    report = convert_videos(args.source, args.out, settings, jobs=args.jobs, scheduler=args.scheduler, **chosen)
    for name, reason in report.failed.items():
        print(f"{name}: {reason}", file=sys.stderr)
    done = f"{report.done:,} converted, {report.kept:,} were there, {len(report.failed):,} failed"
    print(f"{done}; {report.events:,} events in {args.out or default_out(args.source)}")
    return 1 if report.failed else 0
