"""Handwritten digits before a sensor of any size, as a folder of recordings for `--dataset folder`.

    python recipes/draw_digits.py --out digits240 --size 240 180 --events 25000         # needs nvsdata[digits]

scikit-learn's digits are drawn, moved in N-MNIST's three saccades and emulated as in transfer_digits.py, as large as
the sensor: the path and the digit grow with its smaller side. The thresholds are those that give so many events per
recording on average. A stopped run goes on where it was.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from transfer_digits import EMULATORS, SIDE, SOME, as_many, digits

from nvsdata import formats
from nvsdata.commands.options import at_least_1
from nvsdata.training import run
from nvsdata.video.saccades import PATH, saccades


def main() -> None:
    args = arguments()
    width, height = args.size
    scale = min(width, height) / 34
    pictures, labels = digits(round(SIDE * scale))
    path = tuple((x * scale, y * scale) for x, y in PATH)
    # as far from one frame to the next as in transfer_digits.py
    seen = partial(saccades, size=(width, height), path=path, fps=200 * scale)
    settings = as_many(EMULATORS["dvs"], pictures[:: len(pictures) // SOME], args.events, seen)
    print(f"{args.digits} digits by {settings}", flush=True)
    chosen = np.random.default_rng(0).permutation(len(pictures))[: args.digits]
    for n in chosen:
        target = args.out / str(labels[n]) / f"{n:05d}.h5"
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            formats.write(replace(settings, seed=int(n)).emulate(seen(pictures[n])), target)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--out", type=Path, required=True, help="folder for the recordings")
    add("--size", type=at_least_1, nargs=2, default=(240, 180), help="of the sensor in pixels (default 240 180)")
    add("--events", type=at_least_1, default=25_000, help="per recording, on average (default 25,000)")
    add("--digits", type=at_least_1, default=1_000, help="how many recordings (default 1,000; at most 3,594)")
    return parser.parse_args()


if __name__ == "__main__":
    run(main, "the same command goes on where it was")
