"""Ablation study: the effect of settings of graphs, networks and training on accuracy.

    python recipes/ablation.py --dataset n-mnist --root N-MNIST --out runs/ablation
    python recipes/ablation.py --dataset n-mnist --root N-MNIST --out runs/ablation --only k pseudo --seeds 0 --jobs 2
    python recipes/ablation.py --dataset n-cars --root n-cars.nvs --out runs/ablation-n-cars --only features

Each group changes one setting of the defaults of `train_objects.py` for N-MNIST, and of the settings of docs/results.md
for N-CARS. Each choice is trained once per seed. A quarter of the training recordings is for validation, the same for
all (see `hold_out` of the datasets); test recordings aren't used. OUT/runs.jsonl contains a line of JSON per run:
single-window accuracy, accuracy of 5-window voting (N-CARS: of the only window), ms per window from file to class and
minutes of training, both on one core. An interrupted study continues with the runs that are missing. Each group becomes
a table and a chart; OUT/front-window_ms.png and OUT/front-minutes.png show the Pareto fronts of accuracy and cost.

A table has means and standard deviations (±) over the seeds. Points are the difference from the defaults in units of
0.01, the mean over pairs of runs with the same seed, with its 95% interval (Student's). An asterisk marks intervals
without 0.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, starmap
from multiprocessing import active_children, get_context
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory
from typing import Any

import torch
from torch.utils.data import ConcatDataset

from nvsdata import models, plots
from nvsdata.commands.options import at_least_1
from nvsdata.common.files import Journal
from nvsdata.common.text import aligned
from nvsdata.metrics.seeds import by_settings, points_apart, spread
from nvsdata.training import Team, TrainTestSplit, loader, run, votes, window_ms
from nvsdata.training.objects import BATCH, Objects
from nvsdata.transforms.events.sampling import LITERAL_BETA

VALIDATED = 0.25  # fraction of the training recordings on which settings are compared
# graph, network and learning rate of the thesis; augmentation and epochs are those of all runs
THESIS = {
    "k": 8,
    "depth": 3,
    "dropout": 0.5,
    "max_degree": 32,
    "pseudo": "abs",
    "features": (),
    "schedule": "steps",
    "smoothing": 0.0,
}
Groups = dict[str, dict[str, dict[str, Any]]]
N_MNIST: Groups = {
    "default": {"default": {}},
    "k": {f"k = {k}": {"k": k} for k in (1, 2, 4, 8)},
    "metric": {"beta = (5e-6)^2": {}, "beta = 5e-6": {"beta": LITERAL_BETA}},
    "radius": {f"R = {radius}": {"radius": float(radius)} for radius in (2, 3, 4, 5, 7)},
    "degree": {f"D_max = {degree}": {"max_degree": degree} for degree in (4, 8, 16, 32)},
    "pseudo": {kind: {"pseudo": kind} for kind in ("abs", "signed", "signed-time")},
    "kernel": {f"{size} x {size}": {"kernel_size": size} for size in (3, 5, 7)},
    "features": {
        "polarity": {"features": ()},
        "age": {"features": ("age",)},
        **{name: {"features": (name,)} for name in ("mean5", "patch3", "patch5", "patch7")},
    },
    "self-loops": {
        "loops and root weight": {},
        "loops": {"root_weight": False},
        "root weight": {"loops": False},
        "neither": {"loops": False, "root_weight": False},
    },
    "shortcut": {"starts at 0": {}, "starts at 1": {"shortcut_start": 1.0}, "none (G-CNN)": {"network": "gcnn"}},
    "depth": {f"{depth} convolutions": {"depth": depth} for depth in models.SMALL_DEPTHS},
    "dropout": {str(share): {"dropout": share} for share in (0.0, 0.2, 0.5)},
    "width": {f"width x {width}": {"width": width} for width in (0.5, 1.0, 1.5)},
    "augmentation": {"augmented": {}, "as recorded": {"augment": False}},
    "schedule": {
        "one cycle": {},
        "steps": {"schedule": "steps"},
        "no smoothing": {"smoothing": 0.0},
    },
    "convolution": {
        "spline": {"network": "gcnn"},
        **{name: {"network": "gcnn", "convolution": name} for name in ("gin", "gcn", "cheb", "monet")},
        "RG-CNN": {},
    },
    "thesis": {
        "of the thesis": THESIS,
        "with beta = 5e-6": {**THESIS, "beta": LITERAL_BETA},
        "k = 8 alone": {"k": 8},
    },
}


N_CARS: Groups = {
    "default": {"default": {}},
    "features": {
        "counts and times": {"features": ()},
        **{f"counts in {bins} parts": {"features": (f"bins{bins}",)} for bins in (2, 4, 8)},
    },
    "resolution": {f"pixels of {side} x {side}": {"downsample": side} for side in (1, 2)},
    "width": {f"width x {width}": {"width": width} for width in (0.5, 1.0, 2.0)},
    "augmentation": {"augmented": {}, "as recorded": {"augment": False}},
    "negatives": {str(fraction): {"negatives": fraction} for fraction in (0.0, 0.2, 0.4, 0.6)},
    "smoothing": {str(smoothing): {"smoothing": smoothing} for smoothing in (0.0, 0.05)},
    "convolution": N_MNIST["convolution"],
}


@dataclass(frozen=True)
class Study:
    """Protocol whose settings are changed, the changes, epochs, votes per recording and repetitions of the votes."""

    base: Objects
    groups: Groups
    epochs: int
    votes: int
    rounds: int


STUDIES = {
    "n-mnist": Study(Objects("n-mnist"), N_MNIST, epochs=80, votes=5, rounds=5),
    "n-cars": Study(
        Objects(
            "n-cars",
            nodes="pixels",
            downsample=2,
            radius=1.5,
            kernel_size=3,
            window=100_000,
            features=("bins4",),
        ),
        N_CARS,
        epochs=5,
        votes=1,
        rounds=1,
    ),
}


def main() -> None:
    args = arguments()
    study = STUDIES[args.dataset]
    args.out.mkdir(parents=True, exist_ok=True)
    data = TrainTestSplit(args.dataset, args.root, validate=VALIDATED).data
    fixed = {"epochs": args.epochs, "batch": BATCH, "defaults": repr(study.base.settings)}
    fixed |= {name: data[name] for name in ("hash", "validation_hash")}
    with Journal(args.out / "runs.jsonl", {"nvsdata-ablation": 1, **fixed}) as journal:
        if {name: journal.head.get(name) for name in fixed} != fixed:
            differs = [name for name, value in fixed.items() if journal.head.get(name) != value]
            raise ValueError(f"{journal.path} has runs with other {', '.join(differs)}: choose another folder")
        done = {(line["settings"], line["seed"]) for line in journal.lines}
        wanted = {
            (label_of(study, changes), seed): changes
            for seed in args.seeds
            for group in args.only
            for changes in study.groups[group].values()
        }
        waiting = [(changes, seed) for (name, seed), changes in wanted.items() if (name, seed) not in done]
        print(f"{len(wanted) - len(waiting)} runs are done, {len(waiting)} are left")
        for line in run_all(partial(train_and_test, study, args.root, args.epochs), waiting, args.jobs):
            journal.add(line)
            journal.lines.append(line)
            print(json.dumps(line), flush=True)
        report(study, args.out, args.only, journal.lines)


def run_all(work: Callable[..., dict[str, Any]], waiting: list[Any], jobs: int) -> Iterator[dict[str, Any]]:
    """Yield the results of runs as they finish."""
    if jobs == 1:
        yield from starmap(work, waiting)
        return
    pool = ProcessPoolExecutor(jobs, get_context("spawn"))
    try:
        for future in as_completed([pool.submit(work, *run) for run in waiting]):
            yield future.result()
    except BrokenProcessPool:
        raise OSError("a training process was killed (out of memory?): run the command again to continue") from None
    except BaseException:
        # otherwise the pool waits for the end of their training
        for worker in active_children():
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def train_and_test(study: Study, root: Path, epochs: int, changes: dict[str, Any], seed: int) -> dict[str, Any]:
    """Train and test with changed settings; return the result as a line for runs.jsonl."""
    torch.set_num_threads(1)
    here = Team(torch.device("cpu"))
    protocol = replace(study.base, **changes)
    data = TrainTestSplit(protocol.dataset, root, validate=VALIDATED)
    torch.manual_seed(seed)
    train_set = protocol.training_set(data)
    known = {"sensor_size": data.sensor_size, "classes": len(data.classes), "data": data.data}
    with TemporaryDirectory() as folder, redirect_stdout(None):
        trainer = protocol.trainer(
            Path(folder), recordings=len(train_set), team=here, epochs=epochs, seed=seed, **known
        )
        began = core_seconds()
        last = trainer.fit(train_set)
        minutes = (core_seconds() - began) / 60
    # the windows that vote are spread over the recording
    ends = [v / study.votes for v in range(study.votes + 1)]
    shares = [data.validation(protocol.pipeline(training=False, within=within)) for within in pairwise(ends)]
    batches = loader(ConcatDataset(shares), BATCH, here, last=study.rounds, whole_batches=True)
    found = votes(trainer.model, batches, study.votes, here, study.rounds)
    return {
        "settings": label_of(study, changes),
        "seed": seed,
        "one": round(found.single.value, 4),
        "five": round(found.together.value, 4),
        "minutes": round(minutes, 4),
        "window_ms": round(window_ms(trainer.model, data.validation(protocol.pipeline(training=False))), 3),
        "loss": round(last["loss"], 4),
    }


def core_seconds() -> float:
    """Return the CPU time in s of this process and its ended children; other programs don't count."""
    return sum(os.times()[:4])


def label_of(study: Study, changes: dict[str, Any]) -> str:
    """Return the settings that differ from the defaults as text."""
    own = study.base.settings
    differ = {name: value for name, value in sorted(changes.items()) if value != own[name]}
    return ", ".join(f"{name} {value}" for name, value in differ.items()) or "default"


def report(study: Study, out: Path, groups: list[str], lines: list[dict[str, Any]]) -> None:
    """Print a table and draw a chart of each group, and draw the Pareto fronts of all runs."""
    runs = by_settings(lines, RESULTS)
    default = runs.get(label_of(study, {}), {"one": {}, "five": {}})
    for group in groups:
        names = {label: label_of(study, changes) for label, changes in study.groups[group].items()}
        found = {label: runs[name] for label, name in names.items() if name in runs}
        rows = [[group, *RESULTS.values(), "points: single", "points: vote", "seeds"]]
        for label, own in found.items():
            apart = ["" if own is default else points_apart(own[kind], default[kind]) for kind in ("one", "five")]
            rows.append([label, *(spread(own[name].values()) for name in RESULTS), *apart, str(len(own["one"]))])
        print(f"\n{aligned(rows)}")
        if len(found) > 1:
            values = [mean(own["five"].values()) for own in found.values()]
            chart = plots.points_chart(values, list(found), f"{group}: accuracy of {study.votes}-window voting", "")
            plots.save_png(chart, out / f"{group.replace(' ', '-')}.png")
    for cost, xlabel in (("window_ms", "ms per window"), ("minutes", "minutes of training on one core")):
        points = [(mean(own[cost].values()), mean(own["one"].values())) for own in runs.values()]
        chart = plots.tradeoff(points, list(runs), "accuracy and its cost", xlabel, "single-window accuracy")
        plots.save_png(chart, out / f"front-{cost}.png")


RESULTS = {"one": "single", "five": "vote", "window_ms": "ms", "minutes": "minutes"}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--dataset", required=True, choices=STUDIES, help="dataset")
    add("--root", required=True, type=Path, help="folder or packed store of the recordings")
    add("--out", required=True, type=Path, help="folder for runs.jsonl and charts")
    add(
        "--only",
        nargs="+",
        metavar="GROUP",
        help="groups to run (default all): "
        + "; ".join(f"{name}: {', '.join(one.groups)}" for name, one in STUDIES.items()),
    )
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], help="seeds of the trainings (default 0 1 2)")
    add("--epochs", type=at_least_1, help="epochs of each run (default: n-mnist 80, n-cars 5)")
    add("--jobs", type=at_least_1, default=1, help="number of runs at the same time, on one core each (default 1)")
    args = parser.parse_args()
    study = STUDIES[args.dataset]
    args.only, args.epochs = args.only or list(study.groups), args.epochs or study.epochs
    if unknown := set(args.only) - study.groups.keys():
        parser.error(f"--only: no group of {args.dataset} is named {', '.join(sorted(unknown))}")
    return args


if __name__ == "__main__":
    run(main, "run the command again to continue")
