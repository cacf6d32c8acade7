"""Options that the training recipes share."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from nvsdata import models
from nvsdata.commands.options import at_least_1
from nvsdata.datasets import DATASETS
from nvsdata.datasets.damage import ERRORS
from nvsdata.training import actions


def add_data(parser: argparse.ArgumentParser) -> None:
    """Add the options for the recordings."""
    add = parser.add_argument
    add(
        "--dataset",
        required=True,
        choices=sorted(DATASETS),
        help='dataset; "folder" is any folder with a subfolder of recordings for each class',
    )
    add("--root", required=True, type=Path, help="folder or packed store of the recordings")
    add("--out", required=True, type=Path, help="folder for log, checkpoint and model")
    add("--errors", choices=ERRORS, default="raise", help="treatment of damaged recordings (default raise)")


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
    add("--epochs", type=at_least_1, default=actions.EPOCHS, help=f"number of epochs (default {actions.EPOCHS})")
    add("--batch", type=at_least_1, help="samples per step, over all processes (default 32 for 8 graphs, 16 for 16)")
    add_run(parser)


def actions_of(args: argparse.Namespace, *, flip: bool = True) -> actions.Actions:
    """Return the protocol that the options describe."""
    return actions.Actions(args.network, args.temporal, args.graphs, args.duration, args.events, flip)


def run_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of a protocol's `trainer`."""
    return {name: getattr(args, name) for name in ("epochs", "batch", "seed", "resume")}
