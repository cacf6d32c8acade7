"""Train and evaluate a network on recordings of actions (thesis section 5.3.1).

    python recipes/train_actions.py --dataset ucf101-dvs --root UCF101-DVS --out runs/ucf101
    python recipes/train_actions.py --dataset dvs128-gesture --root DvsGesture --duration 500000 --out runs/gesture
    torchrun --nproc-per-node 4 recipes/train_actions.py ...

A recording, or a random part of --duration µs (250000 and 500000 in Table 5.1), is divided into --graphs equal parts (S
in the thesis). A window of 1/30 s of each part becomes a graph, in which every node has an edge from its nearest
neighbor. Augmentation scales by 0.8 to 1 and flips left and right. The optimizer is Adam with learning rate 1e-3,
divided by 10 at 60/150 and 100/150 of the epochs. Batches have 32 samples of 8 graphs, or 16 samples of 16 graphs.

--network also selects a baseline: 3D CNNs on event frames, trained by gradient descent with a learning rate of 0.01,
divided by 10 every 50 epochs; for gestures also PointNet, PointNet++ and LSTM on events. DVS128 Gesture isn't flipped,
because its classes distinguish the left and the right hand.

OUT gets `log.jsonl` (a line per epoch), `checkpoint.pt` and, at the end, `model.safetensors` for `nvsdata.models.load`,
`report.json` and plots (accuracy per class, confusion, calibration, accuracy by votes and by window length, mistakes).
--resume continues an interrupted run, with the same results as without the interruption.

Recordings of these datasets weren't available, so it isn't known whether this reaches the accuracies of the thesis
(docs/models.md).
"""

from __future__ import annotations

import argparse
from functools import cache, partial

import torch
from training_options import actions_of, add_actions, add_data, add_report, run_of

from nvsdata.commands.options import at_least_1
from nvsdata.training import TrainTestSplit, Votes, accuracies, loader, run, team, to_tensorboard, votes, write_report


def main() -> None:
    args = arguments()
    protocol = actions_of(args, flip=args.dataset != "dvs128-gesture")
    torch.manual_seed(args.seed)
    with team(args.device) as here, here.claiming(args.out):
        writer = to_tensorboard(args.out, here) if args.tensorboard else None
        data = TrainTestSplit(args.dataset, args.root, fold=args.fold, seed=args.seed, errors=args.errors)
        train_set = data.train(protocol.pipeline(training=True))
        test_set = data.test(protocol.pipeline(training=False))
        known = {"sensor_size": data.sensor_size, "classes": len(data.classes), "data": data.data}
        trainer = protocol.trainer(args.out, team=here, **known, **run_of(args))
        if writer:
            trainer.watch(writer)
        load = partial(loader, test_set, trainer.batch, here, seed=args.seed)
        test_batches = load()

        @cache
        def last_votes() -> Votes:
            return votes(trainer.model, load(last=args.votes), args.votes, here)

        def evaluate(epoch: int) -> dict[str, float]:
            if epoch < args.epochs:
                return {"test_accuracy": accuracies(trainer.model, test_batches, 1, here)[0]}
            return {"test_accuracy": last_votes().single, "test_accuracy_votes": last_votes().together}

        here.print(f"{len(train_set)} recordings to train on, {len(test_set)} to test on, epochs {trainer.done + 1} on")
        metrics = trainer.fit(train_set, evaluate)
        trainer.publish(data.classes, test_set.transform, metrics)
        if not args.no_report:
            write_report(trainer, data.test, test_set.transform, last_votes(), data.classes)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_data(parser)
    add = parser.add_argument
    add("--fold", type=int, help="number of the train/test split (default 1 for UCF101-DVS and HMDB51-DVS)")
    add("--votes", type=at_least_1, default=5, help="random samples of each recording that vote at the end (default 5)")
    add_actions(parser)
    add_report(parser)
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
