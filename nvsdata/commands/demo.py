"""The `nvsdata demo` command: emulation and training on synthetic data."""

from __future__ import annotations

import argparse
from pathlib import Path

from nvsdata.commands.options import at_least_1, path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add = parser.add_argument
    add("--out", type=path, default=Path("nvsdata-demo"), help="folder for data, network and plots")
    add("--epochs", type=at_least_1, default=40, metavar="N", help="passes over the training set")
    add("--seed", type=int, default=0, help="seed of all random numbers; the same seed gives the same accuracy")


def run(args: argparse.Namespace) -> int:
    """Make the data, train, print the accuracy, and write two plots."""
    from nvsdata.training.demo import train

    train(args.out, args.epochs, args.seed)
    return 0
