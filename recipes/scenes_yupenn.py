"""Recognize the scene of each recording by a network that was trained on others (thesis, section 5.3.3, Table 5.6).

    python recipes/scenes_yupenn.py --root YUPENN-DVS --out runs/yupenn

Leave-one-out: a network is trained for each recording (420 in YUPENN-DVS), by the protocol of `train_actions.py`. With
--groups N, each of N trainings leaves out an N-th of the recordings of each scene. --folds FIRST LAST does only
trainings FIRST to LAST - 1, so that several machines can share them. The recipe writes to OUT
a line for each training in `log.jsonl`, and a folder with its log. --resume continues an interrupted run. The accuracy,
and the variance of the scenes' accuracies, are printed at the end.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections import defaultdict
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import torch
from training_options import actions_of, add_actions, run_of

from nvsdata.commands.options import at_least_1
from nvsdata.common.files import Journal
from nvsdata.datasets import dataset_named
from nvsdata.training import Team, data_of, loader, run, team, votes
from nvsdata.training.actions import Actions


def main() -> None:
    args = arguments()
    protocol = actions_of(args)
    everything = dataset_named(args.dataset)(args.root, "all")
    groups = divided(everything.targets, args.groups or len(everything))
    first, last = args.folds or (0, len(groups))
    log = args.out / "log.jsonl"
    head = {"protocol": repr(protocol), "groups": len(groups), "data": everything.split_hash}
    head |= {"epochs": args.epochs, "seed": args.seed, "votes": args.votes}
    with team(args.device) as here, here.claiming(args.out), ExitStack() as stack:
        if here.rank == 0 and not args.resume:
            log.unlink(missing_ok=True)
        # other processes read the journal after the first has removed an old one
        here.barrier()
        journal = Journal(log, head)
        here.barrier()
        if here.rank == 0:
            stack.enter_context(journal)
        if differ := [f"{name} {journal.head.get(name)}" for name in head if journal.head.get(name) != head[name]]:
            raise SystemExit(f"{log} belongs to a run with {', '.join(differ)}")
        lines = list(journal.lines)
        done = {line["fold"] for line in lines}
        for fold in range(first, min(last, len(groups))):
            if fold not in done:
                lines.append({"fold": fold, **leave_out(args, protocol, everything, groups[fold], fold, here)})
                here.print(json.dumps(lines[-1]))
                if here.rank == 0:
                    journal.add(lines[-1])
        here.print(json.dumps(summary(lines)))


def divided(targets: Sequence[int], count: int) -> list[list[int]]:
    """Divide recordings into groups with the same number of each class, or one more; return their indices."""
    if not 2 <= count <= len(targets):
        raise ValueError(f"{len(targets)} recordings can't be divided into {count} groups")
    by_class = sorted(range(len(targets)), key=targets.__getitem__)
    # like cards dealt to players
    return [sorted(by_class[n::count]) for n in range(count)]


def leave_out(
    args: argparse.Namespace, protocol: Actions, everything: Any, group: list[int], fold: int, here: Team
) -> dict[str, list[str]]:
    """Train on all recordings but those of a group; return the scenes of these, and those that the network names."""
    torch.manual_seed(args.seed)
    train_set, test_set = everything.subset(sorted({*range(len(everything))} - {*group})), everything.subset(group)
    train_set.transform, test_set.transform = (protocol.pipeline(training=training) for training in (True, False))
    data, out = data_of(train_set, test_set, args.seed), args.out / f"fold-{fold:03d}"
    known = {"sensor_size": everything.sensor_size or (240, 180), "classes": len(everything.classes), "data": data}
    trainer = protocol.trainer(out, team=here, **known, **run_of(args))
    trainer.fit(train_set)
    batches = loader(test_set, trainer.batch, here, seed=args.seed, last=args.votes, whole_batches=True)
    found = votes(trainer.model, batches, args.votes, here)
    indices = {"scenes": found.targets, "named": found.voters[0].sum(0).argmax(1)}
    return {name: [everything.classes[n] for n in one.tolist()] for name, one in indices.items()}


def summary(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the accuracy over all recordings, and the mean and variance of the scenes' accuracies."""
    right = defaultdict(list)
    for line in lines:
        for scene, named in zip(line["scenes"], line["named"], strict=True):
            right[scene].append(scene == named)
    accuracies = [statistics.fmean(answers) for answers in right.values()]
    answers = [answer for one in right.values() for answer in one]
    return {
        "recordings": len(answers),
        "accuracy": statistics.fmean(answers) if answers else None,
        "mean_of_scenes": statistics.fmean(accuracies) if accuracies else None,
        "variance_of_scenes": statistics.pvariance(accuracies) if accuracies else None,
        "scenes": dict(sorted(zip(right, accuracies, strict=True))),
    }


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--root", required=True, type=Path, help="folder of the recordings, or a packed store of them")
    add("--dataset", choices=("yupenn-dvs", "folder"), default="yupenn-dvs", help="dataset (default yupenn-dvs)")
    add("--out", required=True, type=Path, help="folder for logs and checkpoints")
    add("--groups", type=at_least_1, help="number of trainings (default: one for each recording)")
    text = "range of trainings, without LAST (default: all)"
    add("--folds", type=int, nargs=2, metavar=("FIRST", "LAST"), help=text)
    add("--votes", type=at_least_1, default=1, help="random samples of a left-out recording that vote (default 1)")
    add_actions(parser)
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
