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
    """Which recordings to train on."""
    add = parser.add_argument
    add("--dataset", required=True, choices=sorted(DATASETS), help="folder: class folders of recordings")
    add("--root", required=True, type=Path, help="folder or packed store of the recordings")
    add("--out", required=True, type=Path, help="folder for log, checkpoint and model")
    add("--errors", choices=ERRORS, default="raise", help="what to do about damaged recordings (default raise)")


def add_run(parser: argparse.ArgumentParser) -> None:
    """How to run a training."""
    add = parser.add_argument
    add("--seed", type=int, default=0, help="of all random numbers (default 0)")
    add("--device", help="default: a GPU if there is one, else cpu")
    add("--resume", action="store_true", help="continue from what is in OUT")


def add_shown(parser: argparse.ArgumentParser) -> None:
    """What a training shows of itself."""
    add = parser.add_argument
    told = "write the log for TensorBoard, too, to OUT/tensorboard (needs nvsdata[tensorboard])"
    add("--tensorboard", action="store_true", help=told)
    add("--no-report", action="store_true", help="end without report.json and its pictures")


def add_actions(parser: argparse.ArgumentParser) -> None:
    """What to train by the protocol `Actions`."""
    add = parser.add_argument
    add("--network", choices=actions.NETWORKS, default="rgcnn3d", help="default rgcnn3d")
    add("--temporal", choices=models.TEMPORAL, default="residual", help="3D CNN of rgcnn3d (default residual)")
    add("--graphs", type=int, choices=(8, 16), default=8, help="S: graphs or frames per sample (default 8)")
    add("--duration", type=at_least_1, help="µs used of each recording, at a random place (default: all)")
    add(
        "--events",
        type=at_least_1,
        default=1024,
        help="events per sample for pointnet, pointnet++ and lstm (default 1024)",
    )
    add("--epochs", type=at_least_1, default=actions.EPOCHS, help=f"default {actions.EPOCHS}")
    add("--batch", type=at_least_1, help="samples per step, over all processes (default 32 for 8 graphs, 16 for 16)")
    add_run(parser)


def actions_of(args: argparse.Namespace, *, flip: bool = True) -> actions.Actions:
    """The protocol that the options describe."""
    return actions.Actions(args.network, args.temporal, args.graphs, args.duration, args.events, flip)


def run_of(args: argparse.Namespace) -> dict[str, Any]:
    """The options that a protocol's `trainer` takes."""
    return {name: getattr(args, name) for name in ("epochs", "batch", "seed", "resume")}
