"""Train and evaluate a network on recordings of objects (thesis section 4.4).

    python recipes/train_objects.py --dataset n-mnist --root N-MNIST --out runs/n-mnist
    torchrun --nproc-per-node 4 recipes/train_objects.py ...

One random 30 ms window a sample, non-uniform sampling, radius graph, augmentation, Adam with
learning rate 1e-3 decayed tenfold at 60/150 and 110/150 of the epochs, batches of 64. Where the
data has no test split, a fifth of each class is held back. --k, --radius, --window, --depth and
--kernel-size are the ablations of Tables 4.1 to 4.5, --convolution that of Table 4.8, and --network
takes the reference networks of 4.4.4, on event images of --image-size pixels (Table 4.6), by gradient descent.

OUT receives `log.jsonl` (a line an epoch), `checkpoint.pt` and, at the end, `model.safetensors` for
`nvsdata.models.load`; a run that was stopped goes on with --resume, as if it hadn't been.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch.utils.data import ConcatDataset

from nvsdata import models
from nvsdata import transforms as T
from nvsdata.datasets import DATASETS
from nvsdata.datasets.damage import ERRORS
from nvsdata.training import Trainer, TrainTestSplit, accuracies, adam, loader, run, sgd, team

THESIS_EPOCHS = 150
# below this many steps 150 epochs are too few to converge: a small dataset is passed more often
LEAST_STEPS = 9_000
# rounds of the last evaluation where the test set has fewer recordings
ROUNDS, FEW = 5, 1_000
IMAGE_NETWORKS = {
    "vgg19": models.reference.VGG,
    "inception-v4": models.reference.InceptionV4,
    "resnet50": models.reference.ResNet,
}


def main() -> None:
    args = arguments()
    torch.manual_seed(args.seed)
    with team(args.device) as here, here.claiming(args.out):
        halves = TrainTestSplit(args.dataset, args.root, seed=args.seed, errors=args.errors)
        train_set = halves.train(pipeline(args, training=True))
        steps = -(-len(train_set) // args.batch)
        epochs = args.epochs or max(THESIS_EPOCHS, -(-LEAST_STEPS // steps))
        model = network(args, halves.sensor_size, len(halves.classes)).to(here.device)
        if args.network in IMAGE_NETWORKS:
            # every 10,000 iterations
            optimizer, schedule = sgd(model, 1e-3, max(1, 10_000 // steps), epochs, decay=1e-5)
        else:
            optimizer, schedule = adam(model, epochs, (60, 110))
        options = {"epochs": epochs, "batch": args.batch, "team": here, "seed": args.seed, "resume": args.resume}
        trainer = Trainer(model, optimizer, schedule, args.out, data=halves.data, **options)

        def test_on(low: float = 0.0, high: float = 1.0) -> Any:
            return halves.test(pipeline(args, training=False, within=(low, high)))

        load = partial(loader, batch=args.batch, team=here, seed=args.seed)
        test_batches = load(test_on())

        def evaluate(epoch: int) -> dict[str, float]:
            if epoch < epochs:
                return {"test_accuracy": accuracies(model, test_batches, 1, here)[0]}
            # accuracies on a small test set would be so by chance: it is gone through again, with other windows
            rounds = ROUNDS if len(test_on()) < FEW else 1
            single = accuracies(model, load(test_on(), last=rounds * args.votes), args.votes, here, rounds)[0]
            # voters spread over the recording know more than voters that may stand together
            shares = [test_on(v / args.votes, (v + 1) / args.votes) for v in range(args.votes)]
            votes = accuracies(model, load(ConcatDataset(shares), last=rounds), args.votes, here, rounds)[1]
            return {"test_accuracy": single, "test_accuracy_votes": votes}

        sizes = f"{len(train_set)} recordings to train on, {len(test_on())} to test on"
        here.say(f"{sizes}, epochs {trainer.done + 1} to {epochs}")
        metrics = trainer.fit(train_set, evaluate)
        trainer.publish(halves.classes, pipeline(args, training=False), metrics)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--errors", choices=ERRORS, default="raise", help="what to do about damaged recordings (default raise)")
    add("--dataset", required=True, choices=sorted(DATASETS), help="folder: class folders of recordings")
    add("--root", required=True, type=Path, help="where the recordings are")
    add("--out", required=True, type=Path, help="where log, checkpoint and model go")
    add("--epochs", type=int, help=f"default: {THESIS_EPOCHS}, or {LEAST_STEPS} steps if that is more")
    add("--batch", type=int, default=64, help="samples a step, over all processes (default 64)")
    add("--window", type=int, default=30_000, help="µs of a window (default 30000; Table 4.3)")
    add("--votes", type=int, default=5, help="windows of a recording that vote at the end (default 5)")
    add("--seed", type=int, default=0)
    add("--device", help="default: a GPU if there is one, else cpu")
    add("--resume", action="store_true", help="go on from the checkpoint in OUT")
    add("--network", choices=("rgcnn", "gcnn", *IMAGE_NETWORKS), default="rgcnn")
    add("--convolution", choices=("spline", *models.CONVOLUTIONS), default="spline", help="of gcnn (Table 4.8)")
    add("--k", type=int, help="events a sampling box, 1 for no sampling (default 8, n-mnist 1; Table 4.1)")
    add("--radius", type=float, default=3.0, help="of the graph, in pixels (default 3; Table 4.2)")
    add("--depth", type=int, choices=sorted(models.DEPTHS), help="convolutions, for 240x180 (Table 4.4)")
    add("--kernel-size", type=int, default=5, help="cells of a kernel along an axis (default 5; Table 4.5)")
    add("--image-size", type=int, default=224, help="of event images (default 224; Table 4.6)")
    args = parser.parse_args()
    if args.k is None:
        # a digit is small: it needs every event
        args.k = 1 if args.dataset == "n-mnist" else 8
    return args


def pipeline(args: argparse.Namespace, *, training: bool, within: tuple[float, float] = (0.0, 1.0)) -> T.Compose:
    """From a recording to what the network takes, augmented for training."""
    window = T.RandomWindow(args.window, within)
    if args.network in IMAGE_NETWORKS:
        scaled = T.Resize(round(args.image_size * 256 / 224))
        crops = (
            [T.RandomCrop(args.image_size), T.RandomHorizontalFlip()] if training else [T.CenterCrop(args.image_size)]
        )
        return T.Compose([window, T.EventImage(), scaled, *crops, T.Normalize()])
    sample = [T.NonUniformSample(args.k)] if args.k > 1 else []
    graph = T.RadiusGraph(args.radius)
    if args.dataset == "n-mnist":
        # a digit's mirror image is no digit
        augment = [T.RandomAffine(scale=(0.85, 1.1), degrees=15, shift=2)] if training else []
        return T.Compose([window, *augment, *sample, graph])
    augment_graph = [T.RandomScale(), T.RandomFlip(0), T.RandomFlip(1), T.RandomRotate()] if training else []
    return T.Compose([window, *sample, graph, *augment_graph])


def network(args: argparse.Namespace, sensor_size: tuple[int, int], classes: int) -> Any:
    """The network asked for; of the thesis's, that for the dataset, or for the smallest sensor that holds this one."""
    if args.network in IMAGE_NETWORKS:
        return IMAGE_NETWORKS[args.network](classes)
    side = max(sensor_size)
    nearest = "n-mnist" if side <= 34 else "cifar10-dvs" if side <= 128 else "asl-dvs"
    name = args.dataset if args.dataset in models.CONFIGURATIONS else nearest
    settings = dict(models.CONFIGURATIONS[name]) | {"num_classes": classes, "kernel_size": args.kernel_size}
    if args.depth:
        settings |= {"sensor_size": (240, 180), "hidden": 1024} | models.DEPTHS[args.depth]
    if args.network == "rgcnn":
        return models.RGCNN(**settings)
    return models.GCNN(**settings, convolution=args.convolution)


if __name__ == "__main__":
    run(main)
