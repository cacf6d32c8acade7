"""Emulate recordings of handwritten digits for a sensor of any size, as a folder for `--dataset folder`.

    python recipes/emulate_digits.py --out digits240 --size 240 180 --events 25000         # needs nvsdata[digits]

scikit-learn's digits are drawn, moved along N-MNIST's three saccades and emulated as in transfer_digits.py. The digit
and its path are scaled with the smaller side of the sensor. Thresholds are chosen so that recordings have --events
events on average. An interrupted run continues.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from transfer_digits import EMULATORS, SIDE, SOME, digits, with_event_count

from nvsdata import formats
from nvsdata.commands.options import at_least_1
from nvsdata.training import run
from nvsdata.video.saccades import PATH, saccades


def main() -> None:
    args = arguments()
    width, height = args.size
    scale = min(width, height) / 34
    images, labels = digits(round(SIDE * scale))
    path = tuple((x * scale, y * scale) for x, y in PATH)
    # the motion per frame is that of transfer_digits.py, in pixels
    seen = partial(saccades, size=(width, height), path=path, fps=200 * scale)
    settings = with_event_count(EMULATORS["dvs"], images[:: len(images) // SOME], args.events, seen)
    print(f"{args.digits} digits by {settings}", flush=True)
    chosen = np.random.default_rng(0).permutation(len(images))[: args.digits]
    for n in chosen:
        target = args.out / str(labels[n]) / f"{n:05d}.h5"
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            formats.write(replace(settings, seed=int(n)).emulate(seen(images[n])), target)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_folder(parser, (240, 180), 25_000)
    text = "number of recordings (default 1,000; at most 3,594)"
    parser.add_argument("--digits", type=at_least_1, default=1_000, help=text)
    return parser.parse_args()


def add_folder(parser: argparse.ArgumentParser, size: tuple[int, int], events: int) -> None:
    """Add the options of recipes that emulate a folder of recordings, with their defaults."""
    add, (width, height) = parser.add_argument, size
    add("--out", type=Path, required=True, help="folder for the recordings")
    text = f"width and height of the sensor in pixels (default {width} {height})"
    add("--size", type=at_least_1, nargs=2, default=size, help=text)
    text = f"mean number of events per recording (default {events:,})"
    add("--events", type=at_least_1, default=events, help=text)


if __name__ == "__main__":
    run(main, "run the command again to continue")
