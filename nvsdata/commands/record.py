"""`nvsdata record`: what a camera sees, or videos that are played in front of it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import get_args

from nvsdata.commands.options import UsageError, add_json, add_videos, path, positive, usage


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    from nvsdata.rig.monitor import Scaling

    add = parser.add_argument
    place = ("X", "Y", "WIDTH", "HEIGHT")
    add("--out", type=path, metavar="OUT", help="a file, whose extension names the format; with --monitor, a folder")
    add("--seconds", type=positive, help="how long to record, in s (default: until Ctrl-C)")
    add("--device", metavar="SERIAL", help="serial number of the camera (default: the only one there)")
    add("--settings", type=path, metavar="FILE.json", help="biases, region, filters and so on (default: the camera's)")
    bias = "coarse and fine current of a bias, such as OnBn=5:255; may be given several times"
    add("--bias", action="append", default=[], metavar="NAME=COARSE:FINE", help=bias)
    add("--region", type=int, nargs=4, metavar=place, help="pixels of the sensor to record (default: all)")
    add("--frames", action="store_true", help="the sensor's gray frames, too (HDF5, AEDAT 2 and AEDAT 4 hold them)")
    simulated = "simulate a camera that sees a moving square or the monitor, with faults such as drift=100"
    add("--simulate", nargs="?", const="", metavar="NAME=NUMBER,...", help=simulated)
    add("--live", action="store_true", help="show events in a window")
    add(
        "--model",
        type=path,
        metavar="MODEL",
        help="a trained network that decides what it sees: a line of JSON each (default: none)",
    )
    add("--note", metavar="TEXT", help="kept with each recording, such as about the room (default: none)")
    add("--overwrite", action="store_true", help="replace what is there")
    add("--list", action="store_true", help="say which cameras are connected, and record nothing")
    add(
        "--doctor",
        action="store_true",
        help="print what a recording with the other options needs and misses, and record nothing",
    )
    add_json(add)
    screen = parser.add_argument_group("playing videos on a monitor")
    add = screen.add_argument
    add("--calibrate", action="store_true", help="aim, focus, find the screen; figures go to OUT")
    add("--monitor", type=path, metavar="IN", help="a folder of videos: play and record each of them")
    add("--resume", action="store_true", help="go on with a folder that holds recordings")
    add("--verify", action="store_true", help="compare what was recorded with the manifest, record nothing")
    corners = (
        "what --calibrate wrote: recordings are compared with where the screen was then (default: with each other)"
    )
    add("--calibration", type=path, metavar="DIR", help=corners)
    alarm = "run by the shell if nothing can be recorded; the reason is in $NVSDATA_ALARM (default: none)"
    add("--on-alarm", metavar="CMD", help=alarm)
    full = "begin although the disk seems too small: a full disk ends the batch, and --resume goes on"
    add("--until-full", action="store_true", help=full)
    add("--status", type=path, metavar="OUT", help="say how a batch is going (default: record)")
    add(
        "--strict",
        action="store_true",
        help="record flagged videos again, and at last refuse them (default: list them)",
    )
    add("--accept-quiet", action="store_true", help="accept recordings with hardly any events, though the video moves")
    add_videos(add)
    add("--display", type=int, default=0, metavar="N", help="number of the display")
    add("--screen-region", type=int, nargs=4, metavar=place, help="pixels of the screen for videos (default: all)")
    add("--scaling", choices=get_args(Scaling), default="aspect", help="videos as large as fits, or a whole multiple")


def run(args: argparse.Namespace) -> int:
    """Record, calibrate, or play and record: 1 if anything was lost, 3 if a batch gave up."""
    from nvsdata.recording import session
    from nvsdata.recording.simulated.options import Simulation
    from nvsdata.rig import session as rig

    if args.status is not None:
        return rig.run_status(args.status, as_json=args.json)
    if args.doctor or args.list:
        screen = args.live or args.calibrate or args.monitor is not None
        folder = args.out if screen and not args.live else args.out and args.out.parent
        how = {"simulated": args.simulate is not None, "as_json": args.json, "screen": screen, "folder": folder}
        return session.run_doctor(everything=args.doctor, **how)
    _check(args)
    with usage():
        given = {"region": args.region and tuple(args.region), "frames": args.frames or None}
        settings = session.settings_of(args.settings, args.bias, **given)
        simulate = None if args.simulate is None else Simulation.of(args.simulate)
    if args.monitor is None and not args.calibrate:
        decider = None
        if args.model is not None:
            # only here: torch takes seconds to start
            from nvsdata import models

            decider = models.OnlineClassifier(models.load(args.model))
        how = {"live": args.live, "overwrite": args.overwrite, "decider": decider, "note": args.note}
        how |= {"as_json": args.json}
        return session.run(args.out, args.seconds, args.device, settings, simulate, **how)
    region = args.screen_region and tuple(args.screen_region)
    screen = {"display": args.display, "region": region, "scaling": args.scaling}
    if args.calibrate:
        out, overwrite = args.out or Path("calibration"), args.overwrite
        return rig.run_calibration(out, args.seconds, args.device, settings, simulate, screen, overwrite=overwrite)
    chosen = {"format": args.format, "limit": args.limit, "resume": args.resume, "check": args.verify}
    chosen |= {"calibration": args.calibration, "strict": args.strict, "accept_quiet": args.accept_quiet}
    chosen |= {"on_alarm": args.on_alarm, "note": args.note, "live": args.live, "as_json": args.json}
    chosen |= {"until_full": args.until_full}
    return rig.run_batch(args.monitor, args.out, args.device, settings, simulate, screen, **chosen)


def _check(args: argparse.Namespace) -> None:
    if args.monitor is None and (args.resume or args.verify):
        raise UsageError("--resume and --verify need --monitor, the folder of videos")
    if args.monitor is not None and args.overwrite:
        raise UsageError("--overwrite is for one recording: with --monitor, --resume goes on, or choose another folder")
    if args.monitor is None and args.until_full:
        raise UsageError("--until-full needs --monitor, the folder of videos")
    if args.calibrate and args.json:
        raise UsageError("--calibrate writes calibration.json: it takes no --json")
    if args.model is not None and (args.monitor is not None or args.calibrate):
        raise UsageError("--model is for one recording: it goes with neither --monitor nor --calibrate")
    if args.note is not None and not args.note.isprintable():
        raise UsageError(f"--note must be text in this terminal's encoding, on one line, not {args.note!r}")
    if args.out is None and not (args.live or args.model or args.calibrate):
        raise UsageError("--out says where the recording goes")
