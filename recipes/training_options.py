"""Options that the training recipes share."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from nvsdata import models
from nvsdata.commands.options import at_least_1, path_or_url
from nvsdata.datasets import DATASETS
from nvsdata.datasets.damage import ERRORS
from nvsdata.training import Team, TrainTestSplit, actions

SHOWN = 5  # maximum number of classes that a warning names


def add_data(parser: argparse.ArgumentParser) -> None:
    """Add the options for the recordings."""
    add = parser.add_argument
    add(
        "--dataset",
        required=True,
        choices=sorted(DATASETS),
        help='dataset; "folder" is any folder with a subfolder of recordings for each class',
    )
    text = "folder of the recordings, or path or URL of a packed store"
    add("--root", required=True, type=path_or_url, help=text)
    add("--out", required=True, type=Path, help="folder for log, checkpoint and model")
    add("--validate", type=float, default=0.0, help="fraction of the training recordings for validation (default 0)")
    text = "epochs without a higher validation accuracy after which training stops (default: never)"
    add("--patience", type=at_least_1, help=text)
    text = "steps after which a checkpoint is also written within an epoch (default: only after each epoch)"
    add("--checkpoint-every", type=at_least_1, metavar="STEPS", help=text)
    text = "shuffle blocks of the packed store, and samples among 64 blocks at a time, for slow disks and servers"
    add("--blocks", action="store_true", help=text)
    add("--from", dest="repeated", type=Path, metavar="REPORT", help="repeat the run that wrote this report.json")
    add("--errors", choices=ERRORS, default="raise", help="treatment of damaged recordings (default raise)")


def order_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return what a run's data state about the order of samples; nothing for a uniform order."""
    return {"order": "blocks"} if args.blocks else {}


def add_run(parser: argparse.ArgumentParser) -> None:
    """Add the options for running a training."""
    add = parser.add_argument
    add("--seed", type=int, default=0, help="seed of all random numbers (default 0)")
    add("--device", help="device of torch (default: a GPU if there is one, else cpu)")
    add("--resume", action="store_true", help="continue the interrupted run in OUT")


def add_report(parser: argparse.ArgumentParser) -> None:
    """Add the options for logs and reports."""
    add = parser.add_argument
    text = "also write the log for TensorBoard to OUT/tensorboard (needs nvsdata[tensorboard])"
    add("--tensorboard", action="store_true", help=text)
    add("--no-report", action="store_true", help="write no report.json and no plots")


def add_actions(parser: argparse.ArgumentParser) -> None:
    """Add the options of the protocol `Actions`."""
    add = parser.add_argument
    add(
        "--network",
        choices=actions.NETWORKS,
        default="rgcnn3d",
        help="network (default rgcnn3d, the graph CNN of the thesis with a 3D CNN); the others are baselines",
    )
    add(
        "--temporal",
        choices=models.TEMPORAL,
        default="residual",
        help="kind of the 3D CNN of rgcnn3d (default residual)",
    )
    add("--graphs", type=int, choices=(8, 16), default=8, help="number of graphs or frames per sample (default 8)")
    add(
        "--duration",
        type=at_least_1,
        help="length in µs of the part of each recording that is used, at a random time (default: all)",
    )
    add(
        "--events",
        type=at_least_1,
        default=1024,
        help="events per sample of pointnet, pointnet++ and lstm (default 1024)",
    )
    add("--width", type=float, default=1.0, help="factor of the channels of rgcnn3d (default 1)")
    add("--no-flip", action="store_true", help="train without flips, for classes that differ in left and right")
    text = "side of the frames of 3D CNNs in pixels (default: that of the thesis, 112 to 224)"
    add("--image-size", type=at_least_1, help=text)
    add("--adam", action="store_true", help="train 3D CNNs on frames by Adam in place of gradient descent")
    add("--epochs", type=at_least_1, default=actions.EPOCHS, help=f"number of epochs (default {actions.EPOCHS})")
    add("--batch", type=at_least_1, help="samples per step, over all processes (default 32 for 8 graphs, 16 for 16)")
    add_run(parser)


def actions_of(args: argparse.Namespace) -> actions.Actions:
    """Return the protocol that the options describe."""
    flip = not args.no_flip and args.dataset != "dvs128-gesture"
    some = {"flip": flip, "width": args.width, "image_size": args.image_size, "adam": args.adam}
    return actions.Actions(args.network, args.temporal, args.graphs, args.duration, args.events, **some)


def parsed(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Parse the command line; with --from, as additions to the command line of the run to repeat.

    `known` is then the description of that run's data.

    Raises:
        ValueError: The file is no report of this recipe, or no other --out is given.
    """
    source = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    source.add_argument("--from", dest="repeated", type=Path)
    known, _ = source.parse_known_args()
    parser.set_defaults(known=None)
    if known.repeated is None:
        return parser.parse_args()
    report = read_report(known.repeated)
    script, *options = report["run"]["command"]
    if Path(script).name != Path(sys.argv[0]).name:
        raise ValueError(f"{known.repeated} is a report of {Path(script).name}")
    before = parser.parse_args(options)
    args = parser.parse_args([*options, *sys.argv[1:]])
    if args.out == before.out:
        raise ValueError(f"--from needs another --out than {args.out}, which has the run to repeat")
    args.resume, args.known = "--resume" in sys.argv[1:], report["data"]
    return args


def read_report(path: Path) -> dict[str, Any]:
    """Read the report of a run. ValueError if it isn't a report."""
    try:
        report = json.loads(path.read_bytes())
        if all(isinstance(word, str) for word in report["run"]["command"]) and isinstance(report["data"], dict):
            return dict(report)
    except (ValueError, KeyError, TypeError, RecursionError):
        pass
    raise ValueError(f"{path} is not the report.json of a run")


def check_data(args: argparse.Namespace, data: TrainTestSplit, here: Team) -> None:
    """Print the numbers of recordings, classes without any, and which test recordings are training recordings, too.

    Raises:
        ValueError: The recordings differ from those of the run to repeat.
    """
    differ = [name for name, value in data.data.items() if args.known is not None and args.known.get(name) != value]
    if differ:
        raise ValueError(f"{args.root} differs from the data of {args.repeated}: {', '.join(differ)}")
    parts = {"training": data.train(None), "validation": data.validation(None), "testing": data.test(None)}
    here.print(", ".join(f"{len(part)} recordings for {use}" for use, part in parts.items() if part is not None))
    for use, part in parts.items():
        counts = {} if part is None else dict(zip(data.classes, part.class_counts, strict=True))
        if empty := [name for name, count in counts.items() if not count]:
            named = ", ".join(empty[:SHOWN]) + (", ..." if len(empty) > SHOWN else "")
            here.print(f"warning: {len(empty)} classes have no recording for {use}: {named}")
    if here.rank == 0 and (same := data.overlap()):
        test, train = next(iter(same.items()))
        here.print(f"warning: {len(same)} test recordings are also training recordings, such as {test} ({train})")


def run_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options that are arguments of a protocol's method `trainer`."""
    return {name: getattr(args, name) for name in ("epochs", "batch", "seed", "resume")}
