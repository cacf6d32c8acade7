"""Train and evaluate a network on recordings of objects (thesis, section 4.4).

    python recipes/train_objects.py --dataset n-mnist --root N-MNIST --out runs/n-mnist
    torchrun --nproc-per-node 4 recipes/train_objects.py ...

A sample is a random 30 ms window. It is subsampled, converted to a radius graph and augmented. The optimizer is Adam
with batches of 64 and a learning rate that rises to 3e-3 and falls again. docs/dev/measurements/departures.md lists the
differences from the thesis and their effect, and how to train with its settings. If the data has no test split, a
random fifth of each class is the test set. --validate 0.1 holds out a tenth of the training recordings: the weights of
the epoch with the highest accuracy on them are kept. Test recordings are used once, at the end. --test-dataset and
--test-root test on another dataset with the same classes: on its test recordings, or on all if it has no test split,
scaled to the sensor of the training recordings. --k, --radius, --window, --depth and --kernel-size are the ablations of
Tables 4.1 to 4.5 of the thesis, --convolution that of Table 4.8. --network also selects a baseline CNN (section 4.4.4)
of event images of --image-size pixels (Table 4.6). It ignores the settings of graphs, and --schedule steps trains it by
gradient descent, as in the thesis.

The recipe writes to OUT `log.jsonl` (a line per epoch), `checkpoint.pt` and, at the end, `model.safetensors` for
`nvsdata.models.load`, `report.json` and plots (accuracy per class, confusion, calibration, accuracy by votes, by window
length and by number of events, mistakes). --resume continues an interrupted run, with the same results as without the
interruption. --from RUN/report.json --out OTHER repeats a run with its command line, commit and data as reported.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from typing import get_args

import torch
from torch.utils.data import ConcatDataset
from training_options import add_data, add_report, add_run, check_data, order_of, parsed, run_of

from nvsdata import models
from nvsdata.commands.options import at_least_1, path_or_url
from nvsdata.data.pseudo import Pseudo
from nvsdata.datasets import DATASETS
from nvsdata.training import Trainer, TrainTestSplit, Votes, loader, run, team, to_tensorboard, votes, write_report
from nvsdata.training.evaluation import validation
from nvsdata.training.objects import BATCH, EPOCHS, FEATURES, LEAST_STEPS, NETWORKS, NODES, SCHEDULES, Objects
from nvsdata.transforms.events.sampling import BETA
from nvsdata.transforms.graphs.edges import PSEUDO

GRAPH = ("nodes", "downsample", "k", "radius", "alpha", "beta", "max_degree", "pseudo", "features", "causal")
NETWORK = ("network", "convolution", "depth", "kernel_size", "dropout", "image_size")
SETTINGS = ("dataset", "window", *GRAPH, *NETWORK, "augment", "negatives", "schedule", "smoothing")
# number of repetitions of the last evaluation if the test set has fewer than FEW recordings
ROUNDS, FEW = 5, 1_000


def main() -> None:
    args = arguments()
    protocol = Objects(**{name: getattr(args, name) for name in SETTINGS} | {"features": tuple(args.features)})
    torch.manual_seed(args.seed)
    with team(args.device) as here, here.claiming(args.out):
        writer = to_tensorboard(args.out, here) if args.tensorboard else None
        test_from = (args.test_dataset, args.test_root) if args.test_dataset else None
        how = {"seed": args.seed, "validate": args.validate, "errors": args.errors}
        data = TrainTestSplit(args.dataset, args.root, **how, test_from=test_from)
        check_data(args, data, here)
        train_set, pipeline = protocol.training_set(data), protocol.pipeline(training=False)
        known = {"sensor_size": data.sensor_size, "classes": len(data.classes), "data": data.data | order_of(args)}
        trainer = protocol.trainer(args.out, recordings=len(train_set), team=here, **known, **run_of(args))
        if writer:
            trainer.watch(writer)
        chosen_by = validation(trainer, data.validation(pipeline))
        blocks = train_set.blocks() if args.blocks else None
        line = trainer.fit(train_set, chosen_by, args.patience, args.checkpoint_every, blocks)
        # test data are used from here on only, when nothing is left to choose
        found = test_votes(args, protocol, trainer, data)
        here.print(str(found))
        accuracies = {"test_accuracy": found.single.value, "test_accuracy_votes": found.together.value}
        trainer.publish(data.classes, pipeline, line | accuracies)
        if not args.no_report:
            write_report(trainer, data.test, pipeline, found, data.classes)


def test_votes(args: argparse.Namespace, protocol: Objects, trainer: Trainer, data: TrainTestSplit) -> Votes:
    """Predict the classes of evenly spaced windows of each test recording; they vote better than random windows."""
    ends = [v / args.votes for v in range(args.votes + 1)]
    parts = [data.test(protocol.pipeline(training=False, within=within)) for within in pairwise(ends)]
    # accuracies on a small test set vary by chance: it is evaluated several times, with other windows
    rounds = ROUNDS if len(parts[0]) < FEW else 1
    how = {"seed": trainer.seed, "last": rounds, "whole_batches": True}
    batches = loader(ConcatDataset(parts), trainer.batch, trainer.team, **how)
    return votes(trainer.model, batches, args.votes, trainer.team, rounds)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_data(parser)
    add = parser.add_argument
    text = "dataset with the same classes to test on, with --test-root (default: that of --dataset)"
    add("--test-dataset", choices=sorted(DATASETS), help=text)
    text = "folder of the recordings to test on, or path or URL of a packed store"
    add("--test-root", type=path_or_url, help=text)
    add(
        "--epochs",
        type=at_least_1,
        help=f"number of epochs (default: {EPOCHS}, or as many as {LEAST_STEPS} steps take if that is more)",
    )
    add("--batch", type=at_least_1, default=BATCH, help=f"samples per step, over all processes (default {BATCH})")
    add("--window", type=at_least_1, default=30_000, help="length of a window in µs (default 30000; Table 4.3)")
    add("--votes", type=at_least_1, default=5, help="windows of each recording that vote at the end (default 5)")
    add(
        "--network",
        choices=NETWORKS,
        default="rgcnn",
        help="network (default rgcnn, the residual graph CNN of the thesis)",
    )
    add(
        "--convolution",
        choices=("spline", *models.CONVOLUTIONS),
        default="spline",
        help="convolution of gcnn (default spline; Table 4.8)",
    )
    add(
        "--k", type=at_least_1, help="keep one event of boxes of up to K; 1 keeps all (default 8, n-mnist 1; Table 4.1)"
    )
    text = "a node per event, or per pixel with the numbers and times of its events (default events)"
    add("--nodes", choices=NODES, default=NODES[0], help=text)
    add("--downsample", type=at_least_1, default=1, help="pixels along each axis that become one (default 1)")
    add("--radius", type=float, default=3.0, help="radius of the graph in pixels (default 3; Table 4.2)")
    add("--alpha", type=float, default=1.0, help="weight of squared pixels in the distance between events (default 1)")
    add(
        "--beta",
        type=float,
        default=BETA,
        help=f"weight of squared µs in the distance between events (default {BETA:.2g})",
    )
    add(
        "--max-degree", type=at_least_1, default=8, help="largest number of neighbors of a node (default 8; thesis: 32)"
    )
    add("--pseudo", choices=get_args(Pseudo), default=PSEUDO, help=f"pseudo-coordinates of edges (default {PSEUDO})")
    add(
        "--features",
        nargs="*",
        choices=sorted(FEATURES),
        default=["patch5"],
        help="features of nodes in addition to polarity (default patch5: numbers of events of 5x5 pixels around it)",
    )
    add("--no-augment", dest="augment", action="store_false", help="train without augmentation")
    text = "probability that a sample of an object becomes a background by moving its parts (default 0; n-cars)"
    add("--negatives", type=float, default=0.0, help=text)
    causal = "train a network for event-by-event inference (docs/streaming.md); needs an empty --features"
    add("--causal", action="store_true", help=causal)
    add("--schedule", choices=SCHEDULES, default=SCHEDULES[0], help="schedule of the learning rate (default one-cycle)")
    add("--smoothing", type=float, default=0.05, help="label smoothing (default 0.05)")
    add("--depth", type=int, help="number of convolutions (default 5 for n-mnist; Table 4.4 for 240x180)")
    add("--dropout", type=float, help="dropout before the last layer (default 0.2 for n-mnist, else 0.5)")
    add("--kernel-size", type=at_least_1, default=5, help="cells of a kernel along each axis (default 5; Table 4.5)")
    add("--image-size", type=at_least_1, default=224, help="side of event images in pixels (default 224; Table 4.6)")
    add_run(parser)
    add_report(parser)
    args = parsed(parser)
    if (args.test_dataset is None) != (args.test_root is None):
        parser.error("--test-dataset and --test-root go together")
    return args


if __name__ == "__main__":
    run(main)
