"""Train on real or emulated recordings, and test on both (thesis, section 3.5.1, Table 3.4).

    nvsdata convert-videos UCF50 --out UCF50-emulated --size 240x180
    python recipes/transfer_emulated.py --real UCF50-DVS --emulated UCF50-emulated --out runs/transfer

Both folders have the same classes and recordings; --dataset determines the split. Polarity is summed to frames of 1 /
--fps s, averaged over 8x8 pixels and scaled to 40x30. The input of the 3D CNN for motion vectors is a clip of 160
consecutive frames, in multi-scale crops of 24x24 that are flipped at random. It is trained by gradient descent with
momentum and a weight decay of 0.0005, for 50,000 iterations; the learning rate is divided by 10 every 20,000. Tests use
5 random clips of each recording, and the mean over the most active and the center crop, each also mirrored.

With --digits as first argument, this runs `recipes/transfer_digits.py`: scikit-learn's digits, emulated, and N-MNIST.

The recipe writes logs, checkpoints and `table.json` to OUT. --resume continues an interrupted run.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import torch

from nvsdata import models
from nvsdata import transforms as T
from nvsdata.commands.options import at_least_1
from nvsdata.common.files import put
from nvsdata.datasets import DATASETS
from nvsdata.metrics import Accuracy
from nvsdata.training import Team, Trainer, TrainTestSplit, loader, run, sgd, team, votes
from nvsdata.transforms.tensors.image import SCALES

KINDS = ("real", "emulated")
SIZE = 24
SMALLER_SIDE = 30  # of 240x180 and of 320x240 alike


def main() -> None:
    if sys.argv[1:2] == ["--digits"]:
        import transfer_digits

        del sys.argv[1]
        return transfer_digits.main()
    args = arguments()
    with team(args.device) as here, here.claiming(args.out):
        data = {
            kind: TrainTestSplit(args.dataset, getattr(args, kind), fold=args.fold, seed=args.seed) for kind in KINDS
        }
        if data["real"].classes != data["emulated"].classes:
            raise SystemExit(f"{args.real} and {args.emulated} don't have the same classes")
        table = {}
        for source in KINDS:
            model = train(args, data[source], args.out / source, here)
            for target in KINDS:
                test_set = data[target].test(test_pipeline(args))
                batches = loader(test_set, args.batch, here, seed=args.seed, last=args.votes, whole_batches=True)
                table[f"{source} -> {target}"] = votes(FourCropped(model), batches, args.votes, here).together
        here.print(as_text(table))
        if here.rank == 0:
            put(args.out / "table.json", json.dumps(table, indent=1).encode())


def train(args: argparse.Namespace, split: TrainTestSplit, out: Path, here: Team) -> torch.nn.Module:
    """Train the 3D CNN on one kind of recordings."""
    torch.manual_seed(args.seed)
    train_set = split.train(train_pipeline(args))
    steps = -(-len(train_set) // args.batch)
    epochs = max(1, -(-args.iterations // steps))
    model = models.reference.MotionVector3D(len(split.classes), frames=args.frames, size=SIZE).to(here.device)
    optimizer, schedule = sgd(model, args.rate, max(1, round(epochs * 20 / 50)), epochs, decay=5e-4)
    options = {"epochs": epochs, "batch": args.batch, "team": here, "seed": args.seed, "resume": args.resume}
    data = split.data | {"protocol": repr(train_pipeline(args))}
    trainer = Trainer(model, optimizer, schedule, out, data=data, **options)
    here.print(f"{out.name}: {len(train_set)} recordings to train on, epochs {trainer.done + 1} to {epochs}")
    metrics = trainer.fit(train_set)
    # the published model uses one crop, because windows of a recording vote
    trainer.publish(split.classes, T.Compose([*clips(args), T.MotionCrop(SIZE), T.Normalize()]), metrics)
    return model


class FourCropped:
    """Network that averages the probabilities of four crops, and returns their logarithm.

    Args:
        model: Network for single crops.
    """

    def __init__(self, model: torch.nn.Module) -> None:
        self.model = model.eval()

    def __call__(self, crops: torch.Tensor) -> torch.Tensor:
        """Return scores [B, num_classes] of crops [B, 4, T, H, W]."""
        scores = self.model(crops.flatten(0, 1)).view(*crops.shape[:2], -1)
        mean: torch.Tensor = scores.softmax(2).mean(1).clamp(min=1e-12).log()
        return mean


def clips(args: argparse.Namespace) -> list[Any]:
    """Return transforms from a recording to a random clip of frames [T, H, W]."""
    return [T.ToFrames(fps=args.fps, values="sum", factor=8), T.Resize(SMALLER_SIDE), T.RandomTemporalCrop(args.frames)]


def train_pipeline(args: argparse.Namespace) -> T.Compose:
    """Return the transform for training, from a recording to an augmented clip [T, 24, 24]."""
    return T.Compose([*clips(args), T.RandomCrop(SIZE, SCALES), T.RandomFlip(), T.Normalize()])


def test_pipeline(args: argparse.Namespace) -> T.Compose:
    """Return the transform for tests, from a recording to four crops of a clip [4, T, 24, 24]."""
    return T.Compose([*clips(args), T.FourCrops(SIZE), T.Normalize()])


def as_text(table: dict[str, Accuracy]) -> str:
    """Return the table as text: a row for each training set, a column for each test set."""
    lines = [f"{'trained on':12}{'real':>10}{'emulated':>10}"]
    lines += [f"{s:12}" + "".join(f"  {table[f'{s} -> {t}']:.3f}" for t in KINDS) for s in KINDS]
    return "\n".join(lines)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--real", required=True, type=Path, help="folder of recordings of a camera")
    add("--emulated", required=True, type=Path, help="folder of the same recordings, emulated")
    add("--out", required=True, type=Path, help="folder for logs, checkpoints and the table")
    add(
        "--dataset",
        choices=sorted(DATASETS),
        default="ucf50-dvs",
        help="dataset that determines classes and splits (default ucf50-dvs)",
    )
    add("--fold", type=int, help="number of the train/test split (default 1)")
    add("--fps", type=float, default=25.0, help="frames per second (default 25, like UCF50's videos)")
    add("--frames", type=at_least_1, default=160, help="frames of a clip (default 160)")
    add("--iterations", type=at_least_1, default=50_000, help="training steps (default 50,000)")
    add("--rate", type=float, default=0.01, help="learning rate at the start (default 0.01)")
    add("--batch", type=at_least_1, default=64, help="samples per step (default 64)")
    add("--votes", type=at_least_1, default=5, help="clips of each recording that vote (default 5)")
    add("--seed", type=int, default=0, help="seed of all random numbers (default 0)")
    add("--device", help="device of torch (default: a GPU if there is one, else cpu)")
    add("--resume", action="store_true", help="continue the interrupted run in OUT")
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
