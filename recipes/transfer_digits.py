"""Train on emulated or real digits, and test on both: Table 3.4 of the thesis (section 3.5.1) on small data.

    python recipes/transfer_digits.py --real N-MNIST --out runs/digits                 # needs nvsdata[digits]
    python recipes/transfer_digits.py --real N-MNIST --out runs/digits --emulator dvs

scikit-learn's 1,797 handwritten digits (8x8 pixels; other digits than MNIST's) are drawn twice in the size of N-MNIST,
with random slant, stroke width and aspect ratio. They are moved along N-MNIST's three saccades and emulated, with noise
and unequal thresholds. The threshold is chosen so that the mean number of events is that of N-MNIST (4,108). Polarity
is inverted, as in the files of N-MNIST. RG-CNN is trained on each kind of recordings, except a fifth of each class. It
is tested by 5-window voting: on that fifth of its kind, and on all recordings of the other kind.

The recipe writes the emulated recordings, the trainings and `table.json` to OUT. --resume continues an interrupted run.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
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
from nvsdata.training import Team, TrainTestSplit, loader, run, team, votes
from nvsdata.training.objects import BATCH, Objects
from nvsdata.video.saccades import saccades
from nvsdata.video.video_frame import VideoFrame

KINDS = ("emulated", "real")
FLAWS: dict[str, float] = {"mismatch": 0.15, "noise_rate": 0.5}
# nearly linear in brightness, and a reference that is constant until a pixel fires: this transfers best
# (docs/dev/measurements/emulation.md)
EMULATORS = {
    "pix2nvs": PIX2NVS(t_log=255, continuous=True, new=False, exp=False, **FLAWS),
    "dvs": DVS(dark=300.0, **FLAWS),
}
EVENTS = 4_108  # mean number of events of N-MNIST's recordings
COPIES = 2  # drawings of each digit
SIDE = 20  # side of a digit in pixels, as in MNIST
SOME = 30  # digits on which the threshold is chosen


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
            data = TrainTestSplit("n-mnist", roots[source], seed=args.seed)
            protocol = Objects("n-mnist")
            model = train(args, data, protocol, args.out / source, here)
            pipeline = protocol.pipeline(training=False)
            for target in KINDS:
                tested = data.test(pipeline) if target == source else NMNIST(roots[target], "all", transform=pipeline)
                batches = loader(tested, BATCH, here, seed=args.seed, last=args.votes, whole_batches=True)
                found = votes(model, batches, args.votes, here)
                here.print(f"{source} -> {target}: {found}")
                table[f"{source} -> {target}"] = found.single, found.together
        here.print(as_text(table))
        if here.rank == 0:
            put(args.out / "table.json", json.dumps(table, indent=1).encode())


def emulate(root: Path, name: str) -> None:
    """Emulate all digits, and write them in the layout of N-MNIST."""
    images, labels = digits()
    settings = with_event_count(EMULATORS[name], images[:: len(images) // SOME], EVENTS, saccades)
    print(f"emulating {len(images)} digits by {settings}", flush=True)
    for n, (still, label) in enumerate(zip(images, labels, strict=True)):
        path = root / "Train" / str(label) / f"{n:05d}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        formats.write(saccade_events(settings, still), path)
    put(root / "done", repr(settings).encode())


def digits(side: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """Draw each digit `COPIES` times.

    Args:
        side: Width and height in pixels (default 20).

    Returns:
        Images, white on black, uint8 [N, side, side], and labels [N].
    """
    try:
        from sklearn.datasets import load_digits
    except ImportError:
        raise ImportError("the digits are scikit-learn's: pip install 'nvsdata[digits]'") from None
    found, rng = load_digits(), np.random.default_rng(0)
    images = [draw(small / 16, rng, side) for _ in range(COPIES) for small in found.images]
    return np.array(images), np.tile(found.target, COPIES)


def draw(small: np.ndarray, rng: np.random.Generator, side: int = SIDE) -> np.ndarray:
    """Scale a digit of 8x8 pixels up in the style of MNIST, with random slant, width and strokes."""
    slant, narrow, turn = rng.uniform(-0.1, 0.4), rng.uniform(0.65, 1.0), rng.uniform(-0.15, 0.15)
    scale = side / 8
    across, along = np.array([narrow, -slant]) * scale, np.array([0, 0.9]) * scale
    way = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ np.stack((across, along))
    middle = np.full(2, (side - 1) / 2) - way @ np.full(2, 3.5)
    where = np.column_stack((way, middle)).astype(np.float32)
    large = cv2.warpAffine(small.astype(np.float32), where, (side, side), flags=cv2.INTER_CUBIC)
    # a higher threshold makes strokes thinner
    sharp = 0.5 + (large - rng.uniform(0.35, 0.65)) * 2.5
    return np.rint(255 * np.clip(sharp, 0, 1)).astype(np.uint8)


def saccade_events(settings: Any, still: np.ndarray) -> Events:
    """Emulate the events of a digit in three saccades; ON means darker, as in N-MNIST."""
    events = settings.emulate(saccades(still))
    return Events(events.t, events.x, events.y, 1 - events.p, events.sensor_size, start=events.start, end=events.end)


def with_event_count(
    settings: Any, images: np.ndarray, events: int, moved: Callable[[np.ndarray], Iterator[VideoFrame]]
) -> Any:
    """Find the threshold at which images have a given mean number of events, within 1% where one has it.

    Args:
        settings: Emulator whose threshold is replaced.
        images: Still images.
        events: Mean number of events.
        moved: Function that returns the frames of a moving image.
    """

    def with_threshold(value: float) -> Any:
        return replace(settings, **({"on": value, "off": value} if isinstance(settings, DVS) else {"threshold": value}))

    wanted = events * len(images)
    low, value, high = 0.02, 0.2, 2.0
    tried: dict[float, int] = {}  # number of events by threshold
    while high / low > 1.01:
        emulator = with_threshold(value)
        found = tried[value] = sum(len(emulator.emulate(moved(still))) for still in images)
        if abs(found - wanted) <= 0.01 * wanted:
            break
        low, high = (value, high) if found > wanted else (low, value)
        # the number of events is nearly inverse to the threshold; every second step halves the range instead
        value *= found / wanted
        if len(tried) % 2 == 0 or not low < value < high:
            value = (low * high) ** 0.5
    return with_threshold(min(tried, key=lambda threshold: abs(tried[threshold] - wanted)))


def train(args: argparse.Namespace, data: TrainTestSplit, protocol: Objects, out: Path, here: Team) -> torch.nn.Module:
    """Train RG-CNN on one kind of recordings."""
    torch.manual_seed(args.seed)
    train_set = data.train(protocol.pipeline(training=True))
    trainer = protocol.trainer(
        out,
        recordings=len(train_set),
        sensor_size=(34, 34),
        classes=len(data.classes),
        data=data.data,
        team=here,
        epochs=args.epochs,
        seed=args.seed,
        resume=args.resume,
    )
    metrics = trainer.fit(train_set)
    trainer.publish(data.classes, protocol.pipeline(training=False), metrics)
    return trainer.model


def as_text(table: dict[str, Any]) -> str:
    """Return the table as text: single-window accuracy / accuracy of voting in each cell."""
    rows: list[tuple[str, ...]] = [("trained on", *(f"tested on {target}" for target in KINDS))]
    for source in KINDS:
        cells = (table[f"{source} -> {target}"] for target in KINDS)
        rows.append((source, *(f"{single.value:.3f} / {voted.value:.3f}" for single, voted in cells)))
    return aligned(rows)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--real", type=Path, required=True, help="folder of N-MNIST")
    add("--out", type=Path, required=True, help="folder for recordings, trainings and the table")
    add("--emulator", choices=EMULATORS, default="dvs", help="emulator (default dvs)")
    add("--epochs", type=at_least_1, default=60, help="number of epochs (default 60)")
    add("--votes", type=at_least_1, default=5, help="windows of each recording that vote (default 5)")
    add("--seed", type=int, default=0, help="seed of all random numbers (default 0)")
    add("--device", help="device of torch (default: a GPU if there is one, else cpu)")
    add("--resume", action="store_true", help="continue the interrupted run in OUT")
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
