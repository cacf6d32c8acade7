"""Recognize the scene of each recording by a network trained on all others (thesis, section 5.3.3, Table 5.6).

    python recipes/scenes_yupenn.py --root YUPENN-DVS --out runs/yupenn

Leave-one-out: a network is trained for each recording (420 in YUPENN-DVS), by the protocol of `train_actions.py`.
--folds FIRST LAST leaves out only recordings FIRST to LAST - 1, so that several machines can share the trainings. The
recipe writes to OUT a line for each recording in `log.jsonl`, and a folder with the log of each training. --resume
continues an interrupted run. The accuracy, and the variance of the scenes' accuracies, are printed at the end.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import torch
from training_options import actions_of, add_actions, run_of

from nvsdata.commands.options import at_least_1
from nvsdata.common.files import Journal
from nvsdata.datasets import YUPENNDVS
from nvsdata.training import Team, data_of, loader, predict, run, team
from nvsdata.training.actions import Actions


def main() -> None:
    args = arguments()
    protocol = actions_of(args)
    everything = YUPENNDVS(args.root, "all")
    first, last = args.folds or (0, len(everything))
    log = args.out / "log.jsonl"
    with team(args.device) as here, here.claiming(args.out), ExitStack() as stack:
        if here.rank == 0 and not args.resume:
            log.unlink(missing_ok=True)
        # other processes read the journal after the first has removed an old one
        here.barrier()
        journal = Journal(log, {"protocol": repr(protocol), "epochs": args.epochs})
        here.barrier()
        if here.rank == 0:
            stack.enter_context(journal)
        if journal.head.get("protocol") != repr(protocol):
            raise SystemExit(f"{log} belongs to a run of {journal.head.get('protocol')}")
        lines = list(journal.lines)
        done = {line["fold"] for line in lines}
        for fold in range(first, min(last, len(everything))):
            if fold not in done:
                lines.append(leave_out(args, protocol, fold, here))
                here.print(json.dumps(lines[-1]))
                if here.rank == 0:
                    journal.add(lines[-1])
        here.print(json.dumps(summary(lines)))


def leave_out(args: argparse.Namespace, protocol: Actions, fold: int, here: Team) -> dict[str, Any]:
    """Train on all recordings but one, and predict the scene of that one."""
    torch.manual_seed(args.seed)
    train_set = YUPENNDVS(args.root, "train", fold=fold, transform=protocol.pipeline(training=True))
    test_set = YUPENNDVS(args.root, "test", fold=fold, transform=protocol.pipeline(training=False))
    data, out = data_of(train_set, test_set, args.seed), args.out / f"fold-{fold:03d}"
    known = {"sensor_size": (240, 180), "classes": len(train_set.classes), "data": data}
    trainer = protocol.trainer(out, team=here, **known, **run_of(args))
    trainer.fit(train_set)
    batches = loader(test_set, 1, here, seed=args.seed, last=args.votes, whole_batches=True)
    scores, targets = predict(trainer.model, batches, here)
    named = int(scores.log_softmax(1).sum(0).argmax())
    return {"fold": fold, "scene": train_set.classes[int(targets[0])], "named": train_set.classes[named]}


def summary(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the accuracy over all recordings, and the mean and variance of the scenes' accuracies."""
    right = defaultdict(list)
    for line in lines:
        right[line["scene"]].append(line["scene"] == line["named"])
    accuracies = [statistics.fmean(answers) for answers in right.values()]
    return {
        "recordings": len(lines),
        "accuracy": statistics.fmean(line["scene"] == line["named"] for line in lines) if lines else None,
        "mean_of_scenes": statistics.fmean(accuracies) if accuracies else None,
        "variance_of_scenes": statistics.pvariance(accuracies) if accuracies else None,
        "scenes": {scene: statistics.fmean(answers) for scene, answers in sorted(right.items())},
    }


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--root", required=True, type=Path, help="folder of YUPENN-DVS, or a store that `nvsdata pack` made from it")
    add("--out", required=True, type=Path, help="folder for logs and checkpoints")
    add(
        "--folds",
        type=int,
        nargs=2,
        metavar=("FIRST", "LAST"),
        help="range of recordings to leave out, without LAST (default: all)",
    )
    add("--votes", type=at_least_1, default=1, help="random samples of the left-out recording that vote (default 1)")
    add_actions(parser)
    return parser.parse_args()


if __name__ == "__main__":
    run(main)
