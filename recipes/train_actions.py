"""Train and evaluate a network on recordings of actions (thesis, section 5.3.1).

    python recipes/train_actions.py --dataset ucf101-dvs --root UCF101-DVS --out runs/ucf101
    python recipes/train_actions.py --dataset dvs128-gesture --root DvsGesture --duration 500000 --out runs/gesture
    torchrun --nproc-per-node 4 recipes/train_actions.py ...

A recording, or a random part of --duration µs (250000 and 500000 in Table 5.1), is divided into --graphs equal parts (S
in the thesis). A window of 1/30 s of each part becomes a graph, in which every node has an edge from its nearest
neighbor. Augmentation scales by 0.8 to 1 and flips left and right. The optimizer is Adam with learning rate 1e-3,
divided by 10 at 60/150 and 100/150 of the epochs. Batches have 32 samples of 8 graphs, or 16 samples of 16 graphs.

--network also selects a baseline: 3D CNNs on event frames, trained by gradient descent with a learning rate of 0.01,
divided by 10 every 50 epochs; for gestures also PointNet, PointNet++ and LSTM on events. DVS128 Gesture isn't flipped,
because its classes distinguish the left and the right hand. --no-flip is for other recordings of such classes.

The recipe writes to OUT `log.jsonl` (a line per epoch), `checkpoint.pt` and, at the end, `model.safetensors` for
`nvsdata.models.load`, `report.json` and plots (accuracy per class, confusion, calibration, accuracy by votes, by window
length and by number of events, mistakes). --validate 0.1 holds out a tenth of the training recordings: the weights of
the epoch with the highest accuracy on them are kept. Test recordings are used once, at the end. --resume continues an
interrupted run, with the same results as without the interruption. --from RUN/report.json --out OTHER repeats a run.

Recordings of these datasets weren't available, so it isn't known whether this reaches the accuracies of the thesis
(docs/results.md).
"""

from __future__ import annotations

import argparse

import torch
from training_options import actions_of, add_actions, add_data, add_report, check_data, order_of, parsed, run_of

from nvsdata.commands.options import at_least_1
from nvsdata.training import TrainTestSplit, loader, run, team, to_tensorboard, votes, write_report
from nvsdata.training.evaluation import validation


def main() -> None:
    args = arguments()
    protocol = actions_of(args)
    torch.manual_seed(args.seed)
    with team(args.device) as here, here.claiming(args.out):
        writer = to_tensorboard(args.out, here) if args.tensorboard else None
        data = TrainTestSplit(
            args.dataset, args.root, fold=args.fold, seed=args.seed, validate=args.validate, errors=args.errors
        )
        check_data(args, data, here)
        train_set, pipeline = data.train(protocol.pipeline(training=True)), protocol.pipeline(training=False)
        known = {"sensor_size": data.sensor_size, "classes": len(data.classes), "data": data.data | order_of(args)}
        trainer = protocol.trainer(args.out, team=here, **known, **run_of(args))
        if writer:
            trainer.watch(writer)
        chosen_by = validation(trainer, data.validation(pipeline))
        blocks = train_set.blocks() if args.blocks else None
        line = trainer.fit(train_set, chosen_by, args.patience, args.checkpoint_every, blocks)
        # test data are used from here on only, when nothing is left to choose
        how = {"seed": args.seed, "last": args.votes, "whole_batches": True}
        batches = loader(data.test(pipeline), trainer.batch, here, **how)
        found = votes(trainer.model, batches, args.votes, here)
        here.print(str(found))
        accuracies = {"test_accuracy": found.single.value, "test_accuracy_votes": found.together.value}
        trainer.publish(data.classes, pipeline, line | accuracies)
        if not args.no_report:
            write_report(trainer, data.test, pipeline, found, data.classes)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_data(parser)
    add = parser.add_argument
    add("--fold", type=int, help="number of the train/test split (default 1 for UCF101-DVS and HMDB51-DVS)")
    add("--votes", type=at_least_1, default=5, help="random samples of each recording that vote at the end (default 5)")
    add_actions(parser)
    add_report(parser)
    return parsed(parser)


if __name__ == "__main__":
    run(main)
