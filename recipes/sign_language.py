r"""Train on gray videos or emulated recordings, and test on real ones (thesis, section 3.5.2, Table 3.5).

    nvsdata convert-videos LETTERS --out LETTERS-emulated --size 240x180
    python recipes/sign_language.py --real LETTERS-DVS --emulated LETTERS-emulated --videos LETTERS --out runs/signs

    python recipes/emulate_signs.py --out signs          # look-alikes, for a small network
    python recipes/sign_language.py --real signs/real --emulated signs/emulated --videos signs/videos --out runs/small \
        --network resnet50 --image-size 32 --no-flip --iterations 1500

Each folder has a subfolder of recordings, or videos, for each letter. VGG-16 is trained on all of --emulated and
--videos, and tested on all of --real. Its three input channels are consecutive frames: sums of polarity over 1 / --fps
s, or gray frames of a video. Frames of a camera are denoised by the median of 2x2 pixels. The smaller side is scaled to
256 pixels. Training takes multi-scale crops of 224x224, flipped at random. The optimizer is gradient descent with
momentum; its learning rate begins at 0.001 and is divided by 10 after each third of 15,000 iterations. The first two
fully connected layers have a dropout of 0.8 and a weight decay of 0.005. Tests average 5 random triples of frames of
each recording, cropped to the most active square.

The thesis begins with weights trained on ImageNet, which aren't part of nvsdata. --weights reads those of torchvision's
vgg16; without it the weights are random at first. ResNet-50 learns more easily from random weights; it is trained by
Adam in one cycle, without weight decay. The recipe writes the logs, the checkpoints and `table.json` to OUT. --resume
continues an interrupted run.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch.utils.data import Dataset
from training_options import add_run

from nvsdata import EventFolder, models
from nvsdata import transforms as T
from nvsdata.batch.folder import videos_in
from nvsdata.commands.options import at_least_1
from nvsdata.common.files import put
from nvsdata.metrics import Accuracy
from nvsdata.training import Team, Trainer, data_of, loader, run, sgd, team, votes
from nvsdata.training.optimizers import one_cycle
from nvsdata.transforms.tensors.image import SCALES
from nvsdata.video.frames import frames_of

SIZE, SMALLER_SIDE, FRAMES = 224, 256, 3  # of the thesis
NETWORKS = {"vgg16": partial(models.reference.VGG, layers=16, dropout=0.8), "resnet50": models.reference.ResNet}


def main() -> None:
    args = arguments()
    if not (args.videos or args.emulated):
        raise SystemExit("nothing to train on: give --emulated, --videos or both")
    with team(args.device) as here, here.claiming(args.out):
        test_set = EventFolder(args.real, transform=test_transform(args))
        table = {}
        if args.videos:
            gray = GrayVideos(args.videos, T.Compose([T.RandomTemporalCrop(FRAMES), *augmented(args)]))
            data = gray.data | {"test_hash": test_set.split_hash, "seed": args.seed}
            table["gray videos"] = accuracy(args, gray, data, test_set, args.out / "gray", here)
        if args.emulated:
            emulated = EventFolder(args.emulated, transform=T.Compose([*triples(args), *augmented(args)]))
            data = data_of(emulated, test_set, args.seed)
            table["emulated"] = accuracy(args, emulated, data, test_set, args.out / "emulated", here)
        here.print("trained on, tested on real recordings:")
        here.print("\n".join(f"{source:12} {found:.2%}" for source, found in table.items()))
        if here.rank == 0:
            put(args.out / "table.json", json.dumps(table, indent=1).encode())


def accuracy(
    args: argparse.Namespace, train_set: Any, data: dict[str, Any], test_set: EventFolder, out: Path, here: Team
) -> Accuracy:
    """Train a network, and return its accuracy on real recordings."""
    if train_set.classes != test_set.classes:
        raise SystemExit(f"{args.real} has the classes {test_set.classes}, not {train_set.classes}")
    torch.manual_seed(args.seed)
    epochs = max(1, -(-args.iterations // -(-len(train_set) // args.batch)))
    model = NETWORKS[args.network](len(test_set.classes), in_channels=FRAMES)
    if args.weights:
        load_weights(model, args.weights)
    model = model.to(here.device)
    if args.network == "resnet50":
        optimizer, schedule = one_cycle(model, epochs, args.rate)
    else:
        full = [layer for layer in model.classify if isinstance(layer, torch.nn.Linear)]
        optimizer, schedule = sgd(model, args.rate, max(1, round(epochs / 3)), epochs, decay=5e-3, decayed=full[:2])
    options = {"epochs": epochs, "batch": args.batch, "team": here, "seed": args.seed, "resume": args.resume}
    protocol = f"{args.network}, rate {args.rate}, weights {args.weights}, {train_set.transform}"
    trainer = Trainer(model, optimizer, schedule, out, data=data | {"protocol": protocol}, **options)
    here.print(f"{out.name}: {len(train_set)} to train on, epochs {trainer.done + 1} to {epochs}")
    metrics = trainer.fit(train_set)
    batches = loader(test_set, args.batch, here, seed=args.seed, last=args.votes, whole_batches=True)
    found = votes(model, batches, args.votes, here).together
    trainer.publish(test_set.classes, test_set.transform, metrics | {"test_accuracy_votes": found.value})
    return found


def load_weights(model: models.reference.VGG, path: Path) -> None:
    """Load the weights of torchvision's vgg16 except the last layer.

    Raises:
        ValueError: The file has other weights.
    """
    given = torch.load(path, map_location="cpu", weights_only=True)
    # torchvision's names; its layers are the same, in the same order
    renamed = {
        name.replace("features.", "maps.", 1).replace("classifier.", "classify.", 1): value
        for name, value in given.items()
        if not name.startswith("classifier.6.")
    }
    wanted = {n: v.shape for n, v in model.state_dict().items() if not n.startswith("classify.6.")}
    if {name: value.shape for name, value in renamed.items()} != wanted:
        raise ValueError(f"{path} doesn't have the weights of torchvision's vgg16")
    model.load_state_dict(renamed, strict=False)


class GrayVideos(Dataset[tuple[Any, int]]):
    """Dataset of videos in a subfolder for each class.

    A sample has all frames in gray, float32 [frames, H, W], after the transform, and the class.

    Args:
        root: Folder of the videos.
        transform: Function of the frames.
    """

    def __init__(self, root: Path, transform: Any) -> None:
        found = videos_in(root, root)
        self.paths, self.transform = [video.path for video in found], transform
        self.classes = sorted({path.parent.name for path in self.paths})
        names = "\n".join(video.name for video in found)
        self.data = {"dataset": "videos", "hash": hashlib.sha256(names.encode()).hexdigest()[:16]}

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> tuple[Any, int]:
        path = self.paths[index]
        images = [frame.pixels for frame in frames_of(path, color=False)]
        gray = [cv2.cvtColor(p, cv2.COLOR_BGR2GRAY) if p.ndim == 3 else p for p in images]
        frames = torch.from_numpy(np.stack(gray).astype(np.float32))
        return self.transform(frames), self.classes.index(path.parent.name)


def triples(args: argparse.Namespace) -> list[Any]:
    """Return transforms from a recording to three consecutive frames [3, H, W] at a random time."""
    return [T.ToFrames(fps=args.fps, values="sum"), T.RandomTemporalCrop(FRAMES)]


def augmented(args: argparse.Namespace) -> list[Any]:
    """Return transforms from three frames to the network's input [3, image_size, image_size], for training."""
    flips = [] if args.no_flip else [T.RandomFlip()]
    return [T.Resize(smaller_side(args)), T.RandomCrop(args.image_size, SCALES), *flips, T.Normalize()]


def test_transform(args: argparse.Namespace) -> T.Compose:
    """Return the transform from a real recording to the network's input [3, image_size, image_size], for tests."""
    crop = [T.Resize(smaller_side(args)), T.MotionCrop(args.image_size)]
    return T.Compose([*triples(args), T.MedianDenoise(), *crop, T.Normalize()])


def smaller_side(args: argparse.Namespace) -> int:
    """Return the smaller side in pixels of the frames that are cropped."""
    return round(args.image_size * SMALLER_SIDE / SIZE)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--real", required=True, type=Path, help="folder of recordings of a camera")
    add("--emulated", type=Path, help="folder of emulated recordings to train on")
    add("--videos", type=Path, help="folder of videos to train on, in gray")
    add("--out", required=True, type=Path, help="folder for logs, checkpoints and the table")
    add("--weights", type=Path, help="weights of torchvision's vgg16, trained on ImageNet (default: random weights)")
    add("--fps", type=float, default=30.0, help="frames per second (default 30)")
    add("--iterations", type=at_least_1, default=15_000, help="training steps (default 15,000)")
    add("--rate", type=float, default=1e-3, help="highest learning rate (default 0.001)")
    add("--batch", type=at_least_1, default=32, help="samples per step (default 32)")
    text = (
        "vgg16 (default), or resnet50, which learns more easily from random weights, by Adam in one cycle of its rate"
    )
    add("--network", choices=NETWORKS, default="vgg16", help=text)
    add("--image-size", type=at_least_1, default=SIZE, help=f"side of the network's input in pixels (default {SIZE})")
    add("--no-flip", action="store_true", help="train without flips, for signs that differ in left and right")
    add("--votes", type=at_least_1, default=5, help="random triples of frames of each recording that vote (default 5)")
    add_run(parser)
    args = parser.parse_args()
    if args.weights and args.network != "vgg16":
        parser.error("--weights is for vgg16")
    return args


if __name__ == "__main__":
    run(main)
