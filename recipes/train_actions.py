"""Train and evaluate a network on recordings of actions (thesis section 5.3.1).

    python recipes/train_actions.py --dataset ucf101-dvs --root UCF101-DVS --out runs/ucf101
    python recipes/train_actions.py --dataset dvs128-gesture --root DvsGesture --duration 500000 --out runs/gesture
    torchrun --nproc-per-node 4 recipes/train_actions.py ...

A sample is S windows of 1/30 s from S equal parts of the recording (or of --duration µs of it, drawn at random: 250000
and 500000 in Table 5.1), each a graph with an edge to every node from its nearest neighbor. Scale from (0.8, 1) and
left-right flips; Adam with learning rate 1e-3, divided by 10 at 60/150 and 100/150 of the epochs; batches of 32 for
S = 8, 16 for 16.

--network also takes the reference networks: 3D CNNs on event frames, by gradient descent from 0.01, divided by 10 every
50 epochs, and for gestures PointNet, PointNet++ and LSTM on events. DVS128 Gesture isn't flipped, because a wave of the
other hand is another gesture.

OUT receives `log.jsonl` (a line per epoch), `checkpoint.pt` and, at the end, `model.safetensors` for
`nvsdata.models.load`, `report.json` and pictures of it (accuracy per class, confusion, calibration, accuracy by votes
and by window length, mistakes). --resume continues a stopped run, with the same results as without the stop.

No recordings of these datasets were at hand: whether this reaches the thesis's accuracies isn't known (docs/models.md).
"""

from __future__ import annotations

import argparse
from functools import cache, partial

import torch
from flags import actions_of, add_actions, add_data, add_shown, run_of

from nvsdata.commands.options import at_least_1
from nvsdata.training import TrainTestSplit, Votes, accuracies, loader, run, team, to_tensorboard, votes, write_report


def main() -> None:
    args = arguments()
    protocol = actions_of(args, flip=args.dataset != "dvs128-gesture")
    torch.manual_seed(args.seed)
    with team(args.device) as here, here.claiming(args.out):
        see = to_tensorboard(args.out, here) if args.tensorboard else None
        halves = TrainTestSplit(args.dataset, args.root, fold=args.fold, seed=args.seed, errors=args.errors)
        train_set = halves.train(protocol.pipeline(training=True))
        test_set = halves.test(protocol.pipeline(training=False))
        known = {"sensor_size": halves.sensor_size, "classes": len(halves.classes), "data": halves.data}
        trainer = protocol.trainer(args.out, team=here, **known, **run_of(args))
        if see:
            trainer.watch(see)
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
        trainer.publish(halves.classes, test_set.transform, metrics)
        if not args.no_report:
            write_report(trainer, halves.test, test_set.transform, last_votes(), halves.classes)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_data(parser)
    add = parser.add_argument
    add("--fold", type=int, help="the dataset's split (default 1 of UCF101-DVS and HMDB51-DVS)")
    add("--votes", type=at_least_1, default=5, help="random draws per recording that vote at the end (default 5)")
    add_actions(parser)
    add_shown(parser)
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
