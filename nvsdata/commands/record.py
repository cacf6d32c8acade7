"""The `nvsdata record` command: recordings of a camera, and of videos that are played on a monitor in front of it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

from nvsdata.commands.options import UsageError, add_json, add_videos, path, positive, usage

ONE = ""  # the mode without an option of its own: one recording
CAMERA = {"device", "settings", "bias", "region", "frames", "simulate"}
SCREEN = {"display", "screen_region", "scaling"}
# options that apply in each mode, in addition to the one that chooses the mode; of several modes, the first one counts
MODES = {
    "status": {"json"},
    "doctor": {"out", "live", "monitor", "calibrate", "simulate", "json"},
    "list": {"simulate", "json"},
    "calibrate": {"out", "seconds", "overwrite"} | CAMERA | SCREEN,
    "monitor": {"out", "resume", "verify", "calibration", "on_alarm", "until_full", "strict", "accept_quiet"}
    | {"format", "limit", "live", "note", "json"}
    | CAMERA
    | SCREEN,
    ONE: {"out", "seconds", "live", "model", "note", "overwrite", "json"} | CAMERA,
}
NO_VALUE: Any = object()  # stands for the folder that --monitor and --status need, so that --help may follow them


class ModeHelp(argparse.Action):
    """Help for the mode whose option precedes `--help`: only the options that apply in this mode."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, *_: Any) -> None:
        """Print the help, and exit."""
        mode = mode_of(namespace)
        used = MODES[mode] | ({mode} if mode else set(MODES))
        every = set().union(*MODES.values(), MODES)
        for action in parser._actions:
            if action.dest in every - used:
                action.help = argparse.SUPPRESS
            if action.const is NO_VALUE:
                action.nargs = None
        parser.print_help()
        parser.exit()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    # replaces argparse's own
    parser._optionals.conflict_handler = "resolve"
    parser.add_argument(
        "-h", "--help", action=ModeHelp, nargs=0, default=argparse.SUPPRESS, help="show this help and exit"
    )
    parser._optionals.conflict_handler = "error"
    _add_recording(parser.add_argument)
    modes = parser.add_argument_group("modes (--help after one of them shows its options)")
    add = modes.add_argument
    folder: dict[str, Any] = {"type": path, "nargs": "?", "const": NO_VALUE}
    add("--monitor", metavar="IN", **folder, help="play and record each video of the folder IN; recordings go to OUT")
    add("--calibrate", action="store_true", help="aim and focus, find the screen, measure flicker; results go to OUT")
    add("--status", metavar="OUT", **folder, help="print the state of the batch that --monitor records to OUT")
    add("--list", action="store_true", help="print the cameras that are connected, and record nothing")
    doctor = "check the requirements of a recording with the other options, and record nothing"
    add("--doctor", action="store_true", help=doctor)
    _add_batch(parser.add_argument_group("videos on a monitor").add_argument)


def _add_recording(add: Callable[..., Any]) -> None:
    """Add the options of one recording, most of which apply to batches, too."""
    add("--out", type=path, metavar="OUT", help="a file, whose extension names the format; a folder with --monitor")
    add("--seconds", type=positive, help="duration of the recording in s (default: until Ctrl-C)")
    add("--device", metavar="SERIAL", help="serial number of the camera (default: the only one that is connected)")
    add("--settings", type=path, metavar="FILE.json", help="biases, region, filters and so on (default: the camera's)")
    bias = "coarse and fine current of a bias, such as OnBn=5:255; may be given several times"
    add("--bias", action="append", default=[], metavar="NAME=COARSE:FINE", help=bias)
    place = ("X", "Y", "WIDTH", "HEIGHT")
    add("--region", type=int, nargs=4, metavar=place, help="pixels of the sensor to record (default: all)")
    add("--frames", action="store_true", help="record gray frames, too (in HDF5, AEDAT 2 and AEDAT 4)")
    simulated = "simulate a camera in front of a moving square or the monitor, with faults such as drift=100"
    add("--simulate", nargs="?", const="", metavar="NAME=NUMBER,...", help=simulated)
    add("--live", action="store_true", help="show events in a window")
    model = "a trained network that classifies the events: prints a line of JSON per decision (default: none)"
    add("--model", type=path, metavar="MODEL", help=model)
    add("--note", metavar="TEXT", help="remark that is stored with each recording, such as the room (default: none)")
    add("--overwrite", action="store_true", help="replace existing files")
    add_json(add)


def _add_batch(add: Callable[..., Any]) -> None:
    """Add the options of `--monitor`, some of which apply to `--calibrate`, too."""
    from nvsdata.rig.monitor import Scaling

    add("--resume", action="store_true", help="continue a batch: record the videos that OUT doesn't have yet")
    add("--verify", action="store_true", help="compare the recordings with the manifest, and record nothing")
    corners = "folder of --calibrate; the screen must be at the same place (default: it is found at the start)"
    add("--calibration", type=path, metavar="DIR", help=corners)
    alarm = "shell command to run when recording is impossible; $NVSDATA_ALARM has the reason (default: none)"
    add("--on-alarm", metavar="CMD", help=alarm)
    full = "start even if the disk is too small: a full disk ends the batch, and --resume continues it"
    add("--until-full", action="store_true", help=full)
    strict = "record flagged videos again, and reject those that stay flagged (default: list them)"
    add("--strict", action="store_true", help=strict)
    add("--accept-quiet", action="store_true", help="accept recordings with hardly any events of videos that move")
    add_videos(add)
    add("--display", type=int, default=0, metavar="N", help="number of the display")
    place = ("X", "Y", "WIDTH", "HEIGHT")
    add("--screen-region", type=int, nargs=4, metavar=place, help="pixels of the screen for videos (default: all)")
    scaling = "scale videos to the largest size that fits, or by a whole number"
    add("--scaling", choices=get_args(Scaling), default="aspect", help=scaling)


def mode_of(args: argparse.Namespace) -> str:
    """Return the mode that the options choose, a key of `MODES`."""
    return next((mode for mode in MODES if mode and getattr(args, mode) not in (None, False)), ONE)


def run(args: argparse.Namespace) -> int:
    """Run the chosen mode; return 1 if data was lost, 3 if a batch was aborted."""
    from nvsdata.recording import session
    from nvsdata.recording.simulated.options import Simulation
    from nvsdata.rig import session as rig
    from nvsdata.rig.batch import BatchOptions

    mode = mode_of(args)
    _check(args, mode)
    if mode == "status":
        return rig.run_status(args.status, as_json=args.json)
    if mode in ("doctor", "list"):
        screen = args.live or args.calibrate or args.monitor is not None
        folder = args.out if screen and not args.live else args.out and args.out.parent
        how = {"simulated": args.simulate is not None, "as_json": args.json, "screen": screen, "folder": folder}
        return session.run_doctor(everything=mode == "doctor", **how)
    with usage():
        given = {"region": args.region and tuple(args.region), "frames": args.frames or None}
        settings = session.settings_of(args.settings, args.bias, **given)
        simulate = None if args.simulate is None else Simulation.of(args.simulate)
        chosen = session.CameraChoice(settings, args.device, simulate, args.note)
    if mode == ONE:
        decider = None
        if args.model is not None:
            # only here: torch takes seconds to start
            from nvsdata import models

            decider = models.OnlineClassifier(models.load(args.model))
        how = {"live": args.live, "overwrite": args.overwrite, "decider": decider, "as_json": args.json}
        return session.run_recording(args.out, args.seconds, chosen, **how)
    region = args.screen_region and tuple(args.screen_region)
    screen = {"display": args.display, "region": region, "scaling": args.scaling}
    if mode == "calibrate":
        out = args.out or Path("calibration")
        return rig.run_calibration(out, args.seconds, chosen, screen, overwrite=args.overwrite)
    if args.verify:
        return rig.run_verification(args.monitor, args.out, args.limit, as_json=args.json)
    options = BatchOptions(**{field.name: getattr(args, field.name) for field in fields(BatchOptions)})
    return rig.run_batch(args.monitor, args.out, chosen, screen, options, as_json=args.json)


def _check(args: argparse.Namespace, mode: str) -> None:
    """Raise UsageError for options that don't apply in this mode, or that are missing."""
    for name in ("monitor", "status"):
        if getattr(args, name) is NO_VALUE:
            raise UsageError(f"argument --{name}: expected one argument")
    # with --doctor, the other options of the line say which recording it is about
    refused = set() if mode == "doctor" else set().union(*MODES.values(), MODES) - MODES[mode] - {mode}
    for name in vars(args):
        if name in refused and getattr(args, name) != args.parser.get_default(name):
            raise UsageError(_refusal(name, mode))
    if args.note is not None and not args.note.isprintable():
        raise UsageError(f"--note must be text in this terminal's encoding, on one line, not {args.note!r}")
    if mode in (ONE, "monitor") and args.out is None and not (mode == ONE and (args.live or args.model)):
        raise UsageError("--out is missing: it names the file or folder of the recording")


def _refusal(name: str, mode: str) -> str:
    """Return the message about an option that doesn't apply in this mode."""
    option = f"--{name.replace('_', '-')}"
    if name in MODES:
        return f"{option} and {_title(mode)} don't go together"
    homes = " and ".join(_title(other) for other in MODES if name in MODES[other] and other != "doctor")
    hint = ": --resume continues a batch, or choose another folder" if (name, mode) == ("overwrite", "monitor") else ""
    return f"{option} is for {homes}, not for {_title(mode)}{hint}"


def _title(mode: str) -> str:
    return f"--{mode}" if mode else "one recording"
