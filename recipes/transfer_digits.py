"""Train on emulated digits and test on real ones: Table 3.4 in small (thesis section 3.5.1), all four cells.

    python recipes/transfer_digits.py --real N-MNIST --out runs/digits                 # needs nvsdata[digits]
    python recipes/transfer_digits.py --real N-MNIST --out runs/digits --emulator dvs

scikit-learn's 1,797 handwritten digits (8x8 pixels; not MNIST's) are drawn twice, as large as N-MNIST's, slanted, thin
and narrow as many of these, then moved in its three saccades and emulated, with a threshold that gives as many events
as N-MNIST's recordings have on average (4,108), some noise and unequal thresholds. Polarity is exchanged, because
N-MNIST's is. RG-CNN learns from each kind, a fifth of which is held back, and is tested by the vote of five windows: on
what was held back of its kind, and on all of the other.

OUT receives the emulated recordings, the trainings and `table.json`; --resume continues a stopped run.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from nvsdata import Events, formats
from nvsdata.commands.options import at_least_1
from nvsdata.common.files import put
from nvsdata.common.text import aligned
from nvsdata.datasets import NMNIST
from nvsdata.emulation import DVS, PIX2NVS
from nvsdata.training import Team, TrainTestSplit, accuracies, loader, run, team
from nvsdata.training.objects import BATCH, Objects
from nvsdata.video.saccades import saccades
from nvsdata.video.video_frame import VideoFrame

KINDS = ("emulated", "real")
FLAWS: dict[str, float] = {"mismatch": 0.15, "noise_rate": 0.5}
# nearly linear in brightness, and a reference that stays until a pixel fires: both carry over best (docs/emulation.md)
EMULATORS = {
    "pix2nvs": PIX2NVS(t_log=255, continuous=True, new=False, exp=False, **FLAWS),
    "dvs": DVS(dark=300.0, **FLAWS),
}
EVENTS = 4_108  # per recording of N-MNIST, on average
COPIES = 2  # of each digit
SIDE = 20  # pixels of a digit, as MNIST draws it
SOME = 30  # digits by which the threshold is found


def main() -> None:
    args = arguments()
    torch.manual_seed(args.seed)
    with team(args.device) as here, here.claiming(args.out):
        roots = {"real": args.real, "emulated": args.out / "emulated"}
        if here.rank == 0 and not (roots["emulated"] / "done").exists():
            emulate(roots["emulated"], args.emulator)
        here.barrier()
        table = {}
        for source in KINDS:
            halves = TrainTestSplit("n-mnist", roots[source], seed=args.seed)
            protocol = Objects("n-mnist")
            model = trained(args, halves, protocol, args.out / source, here)
            pipeline = protocol.pipeline(training=False)
            for target in KINDS:
                tested = halves.test(pipeline) if target == source else NMNIST(roots[target], "all", transform=pipeline)
                batches = loader(tested, BATCH, here, seed=args.seed, last=args.votes)
                table[f"{source} -> {target}"] = accuracies(model, batches, args.votes, here)
        here.print(as_text(table))
        if here.rank == 0:
            put(args.out / "table.json", json.dumps(table, indent=1).encode())


def emulate(root: Path, name: str) -> None:
    """Write all digits as N-MNIST's files, by an emulator whose thresholds give as many events."""
    pictures, labels = digits()
    settings = as_many(EMULATORS[name], pictures[:: len(pictures) // SOME], EVENTS, saccades)
    print(f"emulating {len(pictures)} digits by {settings}", flush=True)
    for n, (still, label) in enumerate(zip(pictures, labels, strict=True)):
        path = root / "Train" / str(label) / f"{n:05d}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        formats.write(seen(settings, still), path)
    put(root / "done", repr(settings).encode())


def digits(side: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """The pictures, white on black, uint8 [N, side, side], and what they show: each `COPIES` times, drawn anew."""
    try:
        from sklearn.datasets import load_digits
    except ImportError:
        raise ImportError("the digits are scikit-learn's: pip install 'nvsdata[digits]'") from None
    found, rng = load_digits(), np.random.default_rng(0)
    pictures = [drawn(small / 16, rng, side) for _ in range(COPIES) for small in found.images]
    return np.array(pictures), np.tile(found.target, COPIES)


def drawn(small: np.ndarray, rng: np.random.Generator, side: int = SIDE) -> np.ndarray:
    """A digit of 8x8 as MNIST draws them: in 20x20 pixels or more, some slanted, narrow or thin."""
    slant, narrow, turn = rng.uniform(-0.1, 0.4), rng.uniform(0.65, 1.0), rng.uniform(-0.15, 0.15)
    scale = side / 8
    across, along = np.array([narrow, -slant]) * scale, np.array([0, 0.9]) * scale
    way = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ np.stack((across, along))
    middle = np.full(2, (side - 1) / 2) - way @ np.full(2, 3.5)
    where = np.column_stack((way, middle)).astype(np.float32)
    large = cv2.warpAffine(small.astype(np.float32), where, (side, side), flags=cv2.INTER_CUBIC)
    # a higher level cuts strokes thinner
    sharp = 0.5 + (large - rng.uniform(0.35, 0.65)) * 2.5
    return np.rint(255 * np.clip(sharp, 0, 1)).astype(np.uint8)


def seen(settings: Any, still: np.ndarray) -> Events:
    """A digit's events in three saccades; ON where it gets darker, as in N-MNIST."""
    events = settings.emulate(saccades(still))
    return Events(events.t, events.x, events.y, 1 - events.p, events.sensor_size, start=events.start, end=events.end)


def as_many(
    settings: Any, pictures: np.ndarray, events: int, moved: Callable[[np.ndarray], Iterator[VideoFrame]]
) -> Any:
    """The settings with thresholds that give so many events on average, to a hundredth, of pictures as they move."""

    def with_threshold(value: float) -> Any:
        return replace(settings, **({"on": value, "off": value} if isinstance(settings, DVS) else {"threshold": value}))

    low, high = 0.02, 2.0
    while high / low > 1.01:
        middle = (low * high) ** 0.5
        more = np.mean([len(with_threshold(middle).emulate(moved(still))) for still in pictures]) > events
        low, high = (middle, high) if more else (low, middle)
    return with_threshold(low)


def trained(
    args: argparse.Namespace, halves: TrainTestSplit, protocol: Objects, out: Path, here: Team
) -> torch.nn.Module:
    """RG-CNN, trained on one kind of recordings."""
    torch.manual_seed(args.seed)
    train_set = halves.train(protocol.pipeline(training=True))
    trainer = protocol.trainer(
        out,
        recordings=len(train_set),
        sensor_size=(34, 34),
        classes=len(halves.classes),
        data=halves.data,
        team=here,
        epochs=args.epochs,
        seed=args.seed,
        resume=args.resume,
    )
    test_batches = partial(loader, halves.test(protocol.pipeline(training=False)), BATCH, here, seed=args.seed)

    def evaluate(epoch: int) -> dict[str, float]:
        return {"test_accuracy": accuracies(trainer.model, test_batches(last=1), 1, here)[0]}

    metrics = trainer.fit(train_set, evaluate)
    trainer.publish(halves.classes, protocol.pipeline(training=False), metrics)
    return trainer.model


def as_text(table: dict[str, Any]) -> str:
    """The four cells: one window, and the vote."""
    rows: list[tuple[str, ...]] = [("trained on", *(f"tested on {target}" for target in KINDS))]
    for source in KINDS:
        cells = (table[f"{source} -> {target}"] for target in KINDS)
        rows.append((source, *(f"{single:.3f} / {voted:.3f}" for single, voted in cells)))
    return aligned(rows)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--real", type=Path, required=True, help="N-MNIST's folder")
    add("--out", type=Path, required=True, help="folder for recordings, trainings and the table")
    add("--emulator", choices=EMULATORS, default="dvs", help="default dvs")
    add("--epochs", type=at_least_1, default=60, help="default 60")
    add("--votes", type=at_least_1, default=5, help="windows per recording that vote (default 5)")
    add("--seed", type=int, default=0, help="of all random numbers (default 0)")
    add("--device", help="default: a GPU if there is one, else cpu")
    add("--resume", action="store_true", help="continue from what is in OUT")
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
