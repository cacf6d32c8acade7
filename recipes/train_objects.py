"""Train and evaluate a network on recordings of objects (thesis section 4.4).

    python recipes/train_objects.py --dataset n-mnist --root N-MNIST --out runs/n-mnist
    torchrun --nproc-per-node 4 recipes/train_objects.py ...

One random 30 ms window per sample, non-uniform sampling, radius graph, augmentation, Adam with a rate that rises
to 3e-3 and falls again, batches of 64. docs/models.md says where this departs from the thesis, by how much, and
how to train by its settings. If the data has no test split, a fifth of each class is held back. --k, --radius,
--window, --depth and --kernel-size are the ablations of Tables 4.1 to 4.5, --convolution that of Table 4.8.
--network also takes the reference networks of 4.4.4, on event images of --image-size pixels (Table 4.6), by
gradient descent; settings of graphs mean nothing to them.

OUT receives `log.jsonl` (a line per epoch), `checkpoint.pt` and, at the end, `model.safetensors` for
`nvsdata.models.load`, `report.json` and pictures of it (accuracy per class, confusion, calibration, accuracy by votes
and by window length, mistakes). --resume continues a stopped run, with the same results as without the stop.
"""

from __future__ import annotations

import argparse
from functools import cache, partial
from typing import Any, get_args

import torch
from flags import add_data, add_run, add_shown, run_of
from torch.utils.data import ConcatDataset

from nvsdata import models
from nvsdata.commands.options import at_least_1
from nvsdata.data.pseudo import Pseudo
from nvsdata.training import TrainTestSplit, Votes, accuracies, loader, run, team, to_tensorboard, votes, write_report
from nvsdata.training.objects import BATCH, EPOCHS, FEATURES, LEAST_STEPS, NETWORKS, SCHEDULES, Objects
from nvsdata.transforms.events.sampling import BETA
from nvsdata.transforms.graphs.edges import PSEUDO

GRAPH = ("k", "radius", "alpha", "beta", "max_degree", "pseudo", "features", "causal")
NETWORK = ("network", "convolution", "depth", "kernel_size", "dropout", "image_size")
SETTINGS = ("dataset", "window", *GRAPH, *NETWORK, "augment", "schedule", "smoothing")
# rounds of the last evaluation if the test set has fewer than FEW recordings
ROUNDS, FEW = 5, 1_000


def main() -> None:
    args = arguments()
    protocol = Objects(**{name: getattr(args, name) for name in SETTINGS} | {"features": tuple(args.features)})
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
    add("--epochs", type=at_least_1, help=f"default: {EPOCHS}, or {LEAST_STEPS} steps if that is more")
    add("--batch", type=at_least_1, default=BATCH, help=f"samples per step, over all processes (default {BATCH})")
    add("--window", type=at_least_1, default=30_000, help="length of a window in µs (default 30000; Table 4.3)")
    add("--votes", type=at_least_1, default=5, help="windows per recording that vote at the end (default 5)")
    add("--network", choices=NETWORKS, default="rgcnn", help="default rgcnn")
    add("--convolution", choices=("spline", *models.CONVOLUTIONS), default="spline", help="of gcnn (Table 4.8)")
    add("--k", type=at_least_1, help="events per sampling box, 1 for no sampling (default 8, n-mnist 1; Table 4.1)")
    add("--radius", type=float, default=3.0, help="of the graph, in pixels (default 3; Table 4.2)")
    add("--alpha", type=float, default=1.0, help="weight of squared pixels in the graph's distance (default 1)")
    add("--beta", type=float, default=BETA, help=f"weight of squared µs in it (default {BETA:.2g})")
    add("--max-degree", type=at_least_1, default=8, help="neighbors of a node at most (default 8; thesis: 32)")
    add("--pseudo", choices=get_args(Pseudo), default=PSEUDO, help=f"pseudo-coordinates of edges (default {PSEUDO})")
    add(
        "--features",
        nargs="*",
        choices=sorted(FEATURES),
        default=["patch5"],
        help="of nodes beside polarity (default patch5: how many events each of 5x5 pixels around a node has)",
    )
    add("--no-augment", dest="augment", action="store_false", help="train on windows as they are")
    causal = "a network that can follow events in real time (docs/streaming.md); needs --features without any"
    add("--causal", action="store_true", help=causal)
    add("--schedule", choices=SCHEDULES, default=SCHEDULES[0], help="of the learning rate (default one-cycle)")
    add("--smoothing", type=float, default=0.05, help="share of a target that goes to all classes (default 0.05)")
    add("--depth", type=int, help="number of convolutions (default 5 for n-mnist; Table 4.4 for 240x180)")
    add("--dropout", type=float, help="before the last layer (default 0.2 for n-mnist, else 0.5)")
    add("--kernel-size", type=at_least_1, default=5, help="cells of a kernel along each axis (default 5; Table 4.5)")
    add("--image-size", type=at_least_1, default=224, help="side of event images in pixels (default 224; Table 4.6)")
    add_run(parser)
    add_shown(parser)
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
