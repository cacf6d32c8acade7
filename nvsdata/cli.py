"""The `nvsdata` command: each subcommand imports what it needs when it runs."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Any


def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand; return the exit code.

    0 is fine, 1 that something failed, 130 interrupted, 128 and a signal's number ended by that signal.
    """
    from nvsdata.common.signals import end_of, ending_by_signals, exit_code

    _open_standard_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # names of files may hold what the terminal can't show
            stream.reconfigure(errors="backslashreplace")
    words = list(sys.argv[1:] if argv is None else argv)
    args = _parser(words[0] if words else "").parse_args(words)
    try:
        with ending_by_signals():
            code: int = args.run(args)
    except KeyboardInterrupt as error:
        print(end_of(error), file=sys.stderr)
        return exit_code(error)
    except BrokenPipeError:
        # who read what is printed has gone; what is left must not be an error at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (OSError, ValueError, ImportError) as error:
        print(f"nvsdata {args.command}: {error}", file=sys.stderr)
        return 1
    return code


def _open_standard_streams() -> None:
    """Have all three, where a shell closed some: the next file opened would take their numbers, and be printed to."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115  for as long as the process runs


def _parser(command: str) -> argparse.ArgumentParser:
    from nvsdata._version import __version__

    parser = argparse.ArgumentParser(prog="nvsdata", description="Datasets, transforms and models for event cameras.")
    parser.add_argument("--version", action="version", version=f"nvsdata {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    demo = commands.add_parser("demo", help="draw moving shapes, turn them into events, train a graph CNN on them")
    demo.add_argument("--out", type=_path, default=Path("nvsdata-demo"), help="folder for data and pictures")
    demo.add_argument("--seconds", type=float, default=60, help="how long to train (default 60)")
    demo.add_argument("--seed", type=int, default=0)
    demo.set_defaults(run=_demo)

    info = commands.add_parser("info", help="what is in files of events: format, sensor, rate, anomalies")
    info.add_argument("files", nargs="+", metavar="FILE", type=_path)
    info.set_defaults(run=_info)

    datasets = commands.add_parser("datasets", help="the datasets: sensor, size, licence, and where they are")
    datasets.add_argument(
        "--root", type=_path, default=Path(), help="folder that datasets are looked for in (default .)"
    )
    datasets.set_defaults(run=_datasets)

    download = commands.add_parser("download", help="fetch and unpack a dataset, or say how to get it by hand")
    download.add_argument("name", metavar="NAME", help="as `nvsdata datasets` calls it")
    download.add_argument("--root", type=_path, help="where it goes (default ./NAME)")
    download.set_defaults(run=_download)

    pack = commands.add_parser(
        "pack", help="put all recordings of a dataset into one file; exit code 1 if any is left out"
    )
    pack.add_argument("root", type=_path, metavar="ROOT", help="the dataset's folder")
    pack.add_argument("--dataset", required=True, metavar="NAME", help="as `nvsdata datasets` calls it, or folder")
    pack.add_argument("--out", required=True, type=_path, metavar="FILE.h5")
    pack.add_argument("--split", default="all", help="pack one split only (default all: any split can be had of it)")
    pack.add_argument("--jobs", type=int, default=1, help="processes that decode (default 1)")
    pack.add_argument("--compress", action="store_true", help="smaller, but slower to read")
    pack.add_argument("--overwrite", action="store_true", help="replace FILE.h5 if it is there")
    pack.set_defaults(run=_pack)

    convert = commands.add_parser("convert", help="a recording in another format")
    convert.add_argument("source", type=_path, metavar="IN")
    convert.add_argument("target", type=_path, metavar="OUT", help="its extension names the format")
    convert.add_argument("--sensor-size", type=_size, metavar="WxH", help="where the file doesn't state it")
    convert.add_argument("--repair", action="store_true", help="drop what is damaged instead of stopping at it")
    convert.add_argument("--overwrite", action="store_true", help="replace OUT if it is there")
    convert.set_defaults(run=_convert)

    videos = commands.add_parser("convert-videos", help="videos to events (PIX2NVS), class folder by class folder")
    videos.add_argument("source", type=_path, metavar="IN", help="a folder of videos, or one video")
    videos.add_argument("--out", type=_path, metavar="DIR", help="where recordings go (default IN-events)")
    videos.add_argument("--format", default="hdf5", help="hdf5, aedat2, aedat3 or text (default hdf5)")
    videos.add_argument("--size", type=_size, metavar="WxH", help="scale frames, for example to 240x180")
    videos.add_argument("--fps", type=float, help="frames a second, whatever the files say")
    videos.add_argument("--jobs", type=int, default=1, help="processes (default 1)")
    videos.add_argument("--scheduler", metavar="ADDRESS", help="have a Dask cluster do it")
    videos.add_argument("--limit", type=int, metavar="N", help="the first N videos only")
    videos.add_argument("--dry-run", action="store_true", help="say what would be done")
    if command == "convert-videos":
        _add_settings(videos)
    videos.set_defaults(run=_convert_videos)

    compare = commands.add_parser("compare", help="how far events are from others: Chamfer, repeatability, EMD")
    compare.add_argument("emulated", type=_path, metavar="A", help="a recording; distances go from it to B")
    compare.add_argument("real", type=_path, metavar="B", help="what it is held to")
    compare.add_argument(
        "--fps", type=float, default=30.0, help="frames a second that events are summed in (default 30)"
    )
    compare.add_argument("--offset", type=int, default=0, metavar="US", help="µs to add to the times of B")
    compare.add_argument("--sensor-size", type=_size, metavar="WxH", help="where the files don't state it")
    compare.add_argument("--picture", type=_path, default=Path("compare.png"), help="where both are drawn side by side")
    compare.set_defaults(run=_compare)

    tune = commands.add_parser(
        "tune",
        help="search for settings of PIX2NVS that come closest to a real recording",
        description="Settings that are given are held, the others searched.",
    )
    tune.add_argument("--real", type=_path, required=True, metavar="REC", help="what a camera saw of the video")
    tune.add_argument("--video", type=_path, required=True, metavar="VID")
    tune.add_argument("--out", type=_path, default=Path("tuning"), metavar="DIR", help="default ./tuning")
    tune.add_argument("--trials", type=int, default=100, help="default 100")
    tune.add_argument("--seconds", type=float, help="compare the first seconds only")
    tune.add_argument("--fps", type=float, help="frames a second, whatever the video says")
    tune.add_argument("--offset", type=int, default=0, metavar="US", help="µs to add to the recording's times")
    tune.add_argument("--jobs", type=int, default=1, help="trials at once (default 1)")
    if command == "tune":
        _add_settings(tune, skip=("seed",))
    tune.add_argument("--seed", type=int, default=0, help="of the search")
    tune.set_defaults(run=_tune)

    record = commands.add_parser("record", help="record a DAVIS camera's events, or videos that it sees on a monitor")
    record.add_argument(
        "--out", type=_path, metavar="OUT", help="a file, whose extension says the format; with --monitor, a folder"
    )
    record.add_argument("--seconds", type=float, help="how long (default: until Ctrl-C)")
    record.add_argument("--device", metavar="SERIAL", help="which camera, if there are several")
    record.add_argument("--settings", type=_path, metavar="FILE.json", help="biases, region, filters and so on")
    record.add_argument("--bias", action="append", default=[], metavar="NAME=COARSE:FINE", help="such as OnBn=5:255")
    record.add_argument("--region", type=int, nargs=4, metavar=("X", "Y", "WIDTH", "HEIGHT"), help="pixels to record")
    record.add_argument(
        "--simulate",
        nargs="?",
        const="",
        metavar="NAME=NUMBER,...",
        help="a camera that isn't there, before a moving square or the monitor; what it suffers, such as drift=100",
    )
    record.add_argument("--live", action="store_true", help="show events in a window")
    record.add_argument("--overwrite", action="store_true", help="replace what is there")
    screen = record.add_argument_group("playing videos on a monitor")
    screen.add_argument("--calibrate", action="store_true", help="aim, focus, find the screen; figures go to OUT")
    screen.add_argument("--monitor", type=_path, metavar="IN", help="a folder of videos: play and record each of them")
    screen.add_argument("--resume", action="store_true", help="go on with a folder that holds recordings")
    screen.add_argument("--verify", action="store_true", help="hold what was recorded to the manifest, record nothing")
    screen.add_argument("--format", default="hdf5", help="hdf5, aedat2, aedat3 or text (default hdf5)")
    screen.add_argument("--limit", type=int, metavar="N", help="the first N videos only")
    screen.add_argument("--display", type=int, default=0, metavar="N", help="which display (default 0)")
    screen.add_argument(
        "--screen-region",
        type=int,
        nargs=4,
        metavar=("X", "Y", "WIDTH", "HEIGHT"),
        help="where videos go (default: all)",
    )
    screen.add_argument("--scaling", default="aspect", help="aspect (as large as fits) or integer (whole numbers)")
    record.set_defaults(run=_record)

    verify = commands.add_parser(
        "verify", help="open every recording, report what is wrong or lacking; exit code 1 if anything is"
    )
    verify.add_argument("root", type=_path, metavar="ROOT", help="a folder or a packed store")
    verify.add_argument("--dataset", metavar="NAME", help="whose sensor and layout to hold it to")
    verify.set_defaults(run=_verify)
    return parser


def _path(text: str) -> Path:
    """A path; the shell leaves the ~ of --out=~/folder to the program."""
    return Path(text).expanduser()


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"WIDTHxHEIGHT, such as 240x180, not {text!r}")
    return int(width), int(height)


def _add_settings(parser: argparse.ArgumentParser, skip: Sequence[str] = ()) -> None:
    """Options for the settings of PIX2NVS; only the command that needs them pays for the import."""
    from dataclasses import fields

    from nvsdata.emulation import PIX2NVS, PRESETS

    group = parser.add_argument_group("settings of PIX2NVS", "each overrides what the preset says")
    group.add_argument("--preset", choices=PRESETS, default="table-3.3-row-5", help="default table-3.3-row-5")
    for field in (field for field in fields(PIX2NVS) if field.name not in skip):
        kind = type(field.default)
        options: dict[str, Any] = {"action": argparse.BooleanOptionalAction} if kind is bool else {"type": kind}
        group.add_argument(f"--{field.name.replace('_', '-')}", **options, default=argparse.SUPPRESS)


def _settings(args: argparse.Namespace) -> Any:
    from dataclasses import fields, replace

    from nvsdata.emulation import PIX2NVS, PRESETS

    given = {field.name: getattr(args, field.name) for field in fields(PIX2NVS) if hasattr(args, field.name)}
    return replace(PRESETS[args.preset], **given)


def _dataset(name: str) -> Any:
    from nvsdata.datasets import dataset_named

    return dataset_named(name)


def _datasets(args: argparse.Namespace) -> int:
    from nvsdata.catalogue import table

    print(table(args.root))
    return 0


def _download(args: argparse.Namespace) -> int:
    from nvsdata.datasets.archives.download import download

    info = _dataset(args.name).info
    for folder in download(info, args.root or Path(info.name)):
        print(folder)
    return 0


def _pack(args: argparse.Namespace) -> int:
    from nvsdata.common.errors import shown
    from nvsdata.datasets.store.writer import pack

    _at_least_1(args, "jobs")
    kind = _dataset(args.dataset)
    dataset = kind.whole(args.root) if args.split == "all" else kind(args.root, args.split)
    report = pack(dataset, args.out, jobs=args.jobs, compress=args.compress, overwrite=args.overwrite)
    for name, reason in report.skipped.items():
        print(f"left out {shown(name)}: {reason}", file=sys.stderr)
    print(f"{report.packed:,} recordings, {report.events:,} events in {args.out}; {len(report.skipped)} left out")
    return 1 if report.skipped else 0


def _convert(args: argparse.Namespace) -> int:
    from nvsdata import formats
    from nvsdata.common.errors import shown
    from nvsdata.common.files import creating

    formats.writer_of(args.target)
    with creating(args.target, overwrite=args.overwrite):
        recording = formats.open(args.source, sensor_size=args.sensor_size, strict=not args.repair)
        if formats.left_out(recording, args.target):
            print(f"{shown(args.target)} holds events alone: frames and inertial samples are left out", file=sys.stderr)
        written = formats.write(recording, args.target)
        if args.source == args.target.with_name(f"{args.target.name}.davis") and not recording.repairs:
            # the recording that it is the journal of is whole now
            args.source.unlink()
    for what, count in recording.repairs.items():
        print(f"{shown(args.source)}: {count} {what}", file=sys.stderr)
    print(f"{written:,} events in {shown(args.target)}")
    return 0


def _convert_videos(args: argparse.Namespace) -> int:
    from nvsdata.emulation.convert import convert_videos, default_out, plan

    _at_least_1(args, "jobs", "limit")
    # threads that decode, emulate and write pass Python's lock on in less than a frame's time
    sys.setswitchinterval(0.0005)
    settings = _settings(args)
    chosen = {"format": args.format, "size": args.size, "fps": args.fps, "limit": args.limit}
    if args.dry_run:
        for job in plan(args.source, args.out, settings, **chosen):
            print(f"{job.video} -> {job.target}")
        print(settings)
        return 0
    report = convert_videos(args.source, args.out, settings, jobs=args.jobs, scheduler=args.scheduler, **chosen)
    for name, reason in report.failed.items():
        print(f"{name}: {reason}", file=sys.stderr)
    done = f"{report.converted:,} converted, {report.kept:,} were there, {len(report.failed):,} failed"
    print(f"{done}; {report.events:,} events in {args.out or default_out(args.source)}")
    return 1 if report.failed else 0


def _compare(args: argparse.Namespace) -> int:
    from nvsdata.comparison import compare_files

    options = {"fps": args.fps, "offset": args.offset, "size": args.sensor_size}
    print(compare_files(args.emulated, args.real, args.picture, **options))
    return 0


def _tune(args: argparse.Namespace) -> int:
    from nvsdata.comparison import tune_files

    _at_least_1(args, "jobs", "trials")
    seed = vars(args).pop("seed")
    options = {name: getattr(args, name) for name in ("trials", "fps", "seconds", "offset", "jobs")}
    print(tune_files(args.real, args.video, args.out, _settings(args), held=vars(args), seed=seed, **options))
    return 0


def _at_least_1(args: argparse.Namespace, *names: str) -> None:
    for name in names:
        value = getattr(args, name)
        if value is not None and value < 1:
            raise ValueError(f"--{name} must be at least 1, not {value}")


def _record(args: argparse.Namespace) -> int:
    from nvsdata.recording.session import run, run_batch, run_calibration, settings_of
    from nvsdata.recording.simulated.options import Simulation

    _at_least_1(args, "limit")
    if args.monitor is None and (args.resume or args.verify):
        raise ValueError("--resume and --verify need --monitor, the folder of videos")
    if args.monitor is not None and args.overwrite:
        raise ValueError("--overwrite is for one recording: with --monitor, --resume goes on, or choose another folder")
    if args.out is None and not (args.live or args.calibrate):
        raise ValueError("--out says where the recording goes")
    if args.seconds is not None and args.seconds <= 0:
        raise ValueError(f"--seconds must be positive, not {args.seconds}")
    settings = settings_of(args.settings, args.bias, region=args.region and tuple(args.region))
    simulate = None if args.simulate is None else Simulation.of(args.simulate)
    if args.monitor is None and not args.calibrate:
        return run(args.out, args.seconds, args.device, settings, simulate, live=args.live, overwrite=args.overwrite)
    screen = {
        "display": args.display,
        "region": args.screen_region and tuple(args.screen_region),
        "scaling": args.scaling,
    }
    if args.calibrate:
        out = args.out or Path("calibration")
        overwrite = args.overwrite
        return run_calibration(out, args.seconds, args.device, settings, simulate, screen, overwrite=overwrite)
    how = {"format": args.format, "limit": args.limit, "resume": args.resume, "check": args.verify}
    return run_batch(args.monitor, args.out, args.device, settings, simulate, screen, **how)


def _verify(args: argparse.Namespace) -> int:
    from nvsdata.common.errors import shown
    from nvsdata.verify import problems

    count = 0
    for name, fault in problems(args.root, args.dataset):
        print(f"{shown(name)}: {fault}")
        count += 1
    print("all sound" if not count else f"{count} faults")
    return 1 if count else 0


def _demo(args: argparse.Namespace) -> int:
    from nvsdata.demo import run

    return run(args.out, seconds=args.seconds, seed=args.seed)


def _info(args: argparse.Namespace) -> int:
    from nvsdata.info import describe

    code = 0
    for path in args.files:
        try:
            text = describe(path)
        except (OSError, ValueError) as error:
            print(error, file=sys.stderr)
            code = 1
        else:
            print(text)
    return code


if __name__ == "__main__":
    sys.exit(main())
