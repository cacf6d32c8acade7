"""Train and evaluate a network on recordings of objects (thesis section 4.4).

    python recipes/train_objects.py --dataset n-mnist --root N-MNIST --out runs/n-mnist
    torchrun --nproc-per-node 4 recipes/train_objects.py ...

One random 30 ms window per sample, non-uniform sampling, radius graph, augmentation, Adam with
learning rate 1e-3, divided by 10 at 60/150 and 110/150 of the epochs, batches of 64. If the data has no
test split, a fifth of each class is held back. --k, --radius, --window, --depth and --kernel-size are
the ablations of Tables 4.1 to 4.5, --convolution that of Table 4.8. --network also takes the reference
networks of 4.4.4, on event images of --image-size pixels (Table 4.6), by gradient descent.

OUT receives `log.jsonl` (a line per epoch), `checkpoint.pt` and, at the end, `model.safetensors` for
`nvsdata.models.load`, `report.json` and pictures of it (accuracy per class, confusion, calibration, accuracy by votes
and by window length, mistakes). --resume continues a stopped run, with the same results as without the stop.
"""

from __future__ import annotations

import argparse
from functools import cache, partial
from typing import Any

import torch
from flags import add_data, add_run, add_shown, run_of
from torch.utils.data import ConcatDataset

from nvsdata import models
from nvsdata.training import TrainTestSplit, Votes, accuracies, loader, run, team, to_tensorboard, votes, write_report
from nvsdata.training.objects import BATCH, EPOCHS, LEAST_STEPS, NETWORKS, Objects

# rounds of the last evaluation if the test set has fewer than FEW recordings
ROUNDS, FEW = 5, 1_000


def main() -> None:
    args = arguments()
    settings = ("dataset", "network", "convolution", "window", "k", "radius", "depth", "kernel_size", "image_size")
    protocol = Objects(**{name: getattr(args, name) for name in settings})
    torch.manual_seed(args.seed)
    with team(args.device) as here, here.claiming(args.out):
        see = to_tensorboard(args.out, here) if args.tensorboard else None
        halves = TrainTestSplit(args.dataset, args.root, seed=args.seed, errors=args.errors)
        train_set = halves.train(protocol.pipeline(training=True))
        known = {"sensor_size": halves.sensor_size, "classes": len(halves.classes), "data": halves.data}
        trainer = protocol.trainer(args.out, recordings=len(train_set), team=here, **known, **run_of(args))
        model = trainer.model
        if see:
            trainer.watch(see)

        def test_on(low: float = 0.0, high: float = 1.0) -> Any:
            return halves.test(protocol.pipeline(training=False, within=(low, high)))

        load = partial(loader, batch=args.batch, team=here, seed=args.seed)
        test_batches = load(test_on())

        # accuracies on a small test set would be so by chance: it is gone through again, with other windows
        rounds = ROUNDS if len(test_on()) < FEW else 1

        @cache
        def last_votes() -> Votes:
            # voters spread over the recording know more than voters that may stand together
            shares = [test_on(v / args.votes, (v + 1) / args.votes) for v in range(args.votes)]
            return votes(model, load(ConcatDataset(shares), last=rounds), args.votes, here, rounds)

        def evaluate(epoch: int) -> dict[str, float]:
            if epoch < trainer.epochs:
                return {"test_accuracy": accuracies(model, test_batches, 1, here)[0]}
            single = accuracies(model, load(test_on(), last=rounds * args.votes), args.votes, here, rounds)[0]
            return {"test_accuracy": single, "test_accuracy_votes": last_votes().together}

        sizes = f"{len(train_set)} recordings to train on, {len(test_on())} to test on"
        here.print(f"{sizes}, epochs {trainer.done + 1} to {trainer.epochs}")
        metrics = trainer.fit(train_set, evaluate)
        pipeline = protocol.pipeline(training=False)
        trainer.publish(halves.classes, pipeline, metrics)
        if not args.no_report:
            write_report(trainer, halves.test, pipeline, last_votes(), halves.classes)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_data(parser)
    add = parser.add_argument
    add("--epochs", type=int, help=f"default: {EPOCHS}, or {LEAST_STEPS} steps if that is more")
    add("--batch", type=int, default=BATCH, help=f"samples per step, over all processes (default {BATCH})")
    add("--window", type=int, default=30_000, help="length of a window in µs (default 30000; Table 4.3)")
    add("--votes", type=int, default=5, help="windows per recording that vote at the end (default 5)")
    add("--network", choices=NETWORKS, default="rgcnn", help="default rgcnn")
    add("--convolution", choices=("spline", *models.CONVOLUTIONS), default="spline", help="of gcnn (Table 4.8)")
    add("--k", type=int, help="events per sampling box, 1 for no sampling (default 8, n-mnist 1; Table 4.1)")
    add("--radius", type=float, default=3.0, help="of the graph, in pixels (default 3; Table 4.2)")
    add("--depth", type=int, choices=sorted(models.DEPTHS), help="number of convolutions, for 240x180 (Table 4.4)")
    add("--kernel-size", type=int, default=5, help="cells of a kernel along each axis (default 5; Table 4.5)")
    add("--image-size", type=int, default=224, help="side of event images in pixels (default 224; Table 4.6)")
    add_run(parser)
    add_shown(parser)
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
