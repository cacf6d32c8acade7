"""Measure how the accuracy of networks falls if test recordings are corrupted.

    python recipes/robustness.py --dataset n-mnist --root N-MNIST --out runs/robustness
    python recipes/robustness.py --dataset n-mnist --root N-MNIST --out OUT --seed 2 --runs runs/rg-cnn runs/resnet50

Networks are those of --runs, folders of `train_objects.py`. Without it, RG-CNN (a node per pixel) and ResNet-50 on
event images are trained in OUT. HATS with a linear SVM, by the protocol of `baselines.py`, is always trained. Only test
recordings are corrupted, and nothing is chosen on them. All networks get the same corrupted recordings: random numbers
depend on the number of the recording alone.

- noise: random events, at a rate in events per pixel and s.
- dropped events: each event is dropped with this probability.
- time jitter: normally distributed, with this standard deviation in ms.
- shift: by pixels in a random direction along an axis; events that leave the sensor are dropped.
- speed: times are divided by this factor.
- contrast: 1/n for a scene of n times less contrast. Each event is one step of its pixel's brightness. An event is kept
  where the steps since the last kept one add up to n, so a step back cancels one ahead.

Networks vote by --votes windows of a recording, spread evenly, and HATS uses the entire recording. OUT/cells.jsonl gets
a line for each network, corruption and strength. An interrupted run continues with those that are missing. At the end,
there are OUT/robustness.json and a plot, OUT/robustness.png. Intervals are 95% intervals over recordings (Wilson).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import baselines
import numpy as np
import torch

from nvsdata import Events, metrics, models, plots
from nvsdata import transforms as T
from nvsdata.commands.options import at_least_1
from nvsdata.common.files import Journal, put
from nvsdata.common.text import aligned
from nvsdata.datasets import DATASETS
from nvsdata.plots.axes import LINES, new_figure, rendered, style_axes
from nvsdata.training import TrainTestSplit, run
from nvsdata.transforms.rng import deterministic_rng, generator, randint

HATS = "HATS + SVM"
CLEAN = "none"
# networks that are trained without --runs, and their options of train_objects.py
NETWORKS = {
    "rg-cnn": "--nodes pixels --radius 1.5 --kernel-size 3 --window 100000 --features bins4",
    "resnet50": "--network resnet50 --image-size 32 --window 100000 --batch 32",
}
Classifier = Callable[[list[Events]], np.ndarray]


def noise(events: Events, rate: float) -> Events:
    """Add random events, `rate` per pixel and s."""
    width, height = events.sensor_size
    count = round(rate * width * height * (events.end - events.start) / 1e6)
    added: Events = T.UniformNoise(count)(events)
    return added


def drop(events: Events, fraction: float) -> Events:
    """Drop each event with a probability; events dropped at a low one are dropped at all higher ones."""
    return events[(torch.rand(len(events), generator=generator()) >= fraction).numpy()]


def jitter(events: Events, sigma: float) -> Events:
    """Move events in time by normally distributed durations with a standard deviation in ms."""
    moved: Events = T.TimeJitter(1_000 * sigma)(events)
    return moved


def shift(events: Events, pixels: float) -> Events:
    """Shift events by pixels to the right, left, bottom or top, at random."""
    dx, dy = ((1, 0), (-1, 0), (0, 1), (0, -1))[randint(4)]
    moved: Any = T.affine(events, dx=dx * pixels, dy=dy * pixels)
    return moved


def speed(events: Events, factor: float) -> Events:
    """Divide times by a factor."""
    scaled: Events = T.RandomTimeScale(1 / factor, 1 / factor)(events)
    return scaled


def lower_contrast(events: Events, divisor: float) -> Events:
    """Keep the events of a scene with less contrast, or of a threshold that is `divisor` times as high.

    Args:
        events: Events, each of which is a step of its pixel's brightness.
        divisor: Number of steps, up or down, since the last kept event of a pixel at which an event is kept.

    Returns:
        The kept events.
    """
    pixels = events.y.astype(np.int64) * events.sensor_size[0] + events.x
    steps = np.where(events.p > 0, 1, -1)
    change: dict[int, int] = defaultdict(int)  # of a pixel since its last kept event
    kept = np.zeros(len(events), bool)
    for i, (pixel, step) in enumerate(zip(pixels.tolist(), steps.tolist(), strict=True)):
        change[pixel] += step
        if abs(change[pixel]) >= divisor:
            kept[i], change[pixel] = True, 0
    return events[kept]


@dataclass(frozen=True)
class Corruption:
    """A corruption, the name of its strength, the strength without effect, and those that are measured."""

    change: Callable[[Events, float], Events]
    label: str
    none: float
    strengths: tuple[float, ...]


CORRUPTIONS = {
    "noise": Corruption(noise, "random events per pixel and s", 0, (1, 3, 10, 30)),
    "dropped events": Corruption(drop, "fraction of events dropped", 0, (0.5, 0.75, 0.9, 0.95)),
    "time jitter": Corruption(jitter, "standard deviation in ms", 0, (3, 10, 30, 100)),
    "shift": Corruption(shift, "pixels", 0, (1, 2, 4, 6)),
    "speed": Corruption(speed, "factor of the speed", 1, (0.25, 0.5, 2, 4)),
    "contrast": Corruption(lower_contrast, "contrast divided by", 1, (2, 3, 4, 6)),
}


def main() -> None:
    args = arguments()
    # rounding depends on the number of threads
    torch.set_num_threads(1)
    folders = args.runs or list(trained_in(args))
    data = TrainTestSplit(args.dataset, args.root, seed=args.seed, validate=args.validate)
    networks = {folder.name: network(folder, data, args.votes) for folder in folders}
    if len(networks) < len(folders):
        raise ValueError("the folders of --runs must have different names")
    weights = {folder.name: sha256(weights_of(folder).read_bytes()).hexdigest()[:16] for folder in folders}
    job = {"nvsdata-robustness": 1, "dataset": args.dataset, "seed": args.seed, "votes": args.votes}
    job |= {name: data.data[name] for name in ("hash", "test_hash")}
    args.out.mkdir(parents=True, exist_ok=True)
    with Journal(args.out / "cells.jsonl", job) as journal:
        if journal.head != job:
            raise ValueError(f"{journal.path} is of other recordings or settings: choose another folder")
        lines = fill(journal, networks, weights, data)
    cells = [{name: line[name] for name in line if name not in ("right", "weights")} for line in lines]
    found = job | {"recordings": len(data.test(None)), "weights": weights, "cells": cells}
    put(args.out / "robustness.json", f"{json.dumps(found, indent=1)}\n".encode())
    plots.save_png(chart(cells), args.out / "robustness.png")
    print(aligned(table(cells)))


def trained_in(args: argparse.Namespace) -> Iterator[Path]:
    """Train the networks that aren't in OUT yet; yield their folders."""
    for name, options in NETWORKS.items():
        folder = args.out / name
        if not (folder / "report.json").is_file():
            recipe = Path(__file__).with_name("train_objects.py")
            where = ("--dataset", args.dataset, "--root", args.root, "--out", folder, "--seed", args.seed)
            common = ("--validate", args.validate, "--resume", *(("--epochs", args.epochs) if args.epochs else ()))
            words = map(str, (sys.executable, recipe, *where, *common, *options.split()))
            if subprocess.run(list(words), check=False).returncode:
                raise ValueError(f"the training in {folder} failed")
        yield folder


def weights_of(folder: Path) -> Path:
    """Return the path of the network of a run."""
    return folder / "model.safetensors"


def network(folder: Path, data: TrainTestSplit, votes: int) -> Classifier:
    """Return a function from recordings to classes, by a trained network that wasn't trained on the test recordings."""
    trained = models.load(weights_of(folder))
    ours, theirs = ((of["dataset"], of["test_hash"]) for of in (data.data, trained.data))
    if ours != theirs:
        raise ValueError(f"{folder} was trained on other recordings: choose its dataset, root and --seed")
    return lambda recordings: trained.predict_proba(recordings, windows=votes).argmax(1).numpy()


def hats(data: TrainTestSplit) -> Classifier:
    """Return a function from recordings to classes, by HATS and a linear SVM of the training recordings."""
    pairs = decoded(data.train(lambda recording: recording.read()))
    train, labels = [events for events, _ in pairs], np.array([label for _, label in pairs])
    settings, penalty, _ = baselines.best_hats(train, labels)
    features = baselines.averaged_surfaces(train, **settings)

    def classify(recordings: list[Events]) -> np.ndarray:
        tested = baselines.averaged_surfaces(recordings, **settings)
        return baselines.svm(*baselines.prepared(features, tested), labels, penalty)

    return classify


def decoded(part: Any) -> list[tuple[Events, int]]:
    """Return the recordings of a dataset."""
    return [part[i] for i in range(len(part))]


def fill(
    journal: Journal, networks: dict[str, Classifier], weights: dict[str, str], data: TrainTestSplit
) -> list[dict[str, Any]]:
    """Measure what the journal doesn't have yet; return the lines of these networks."""
    cells = [(CLEAN, 0.0)] + [(name, float(s)) for name, one in CORRUPTIONS.items() for s in one.strengths]
    known = {(line["network"], line["weights"], line["corruption"], line["strength"]): line for line in journal.lines}
    keys = {(name, weights.get(name), *cell): cell for cell in cells for name in (*networks, HATS)}
    pairs = decoded(data.test(lambda recording: recording.read()))
    recordings, truth = [events for events, _ in pairs], np.array([label for _, label in pairs])
    if any(key[0] == HATS and key not in known for key in keys):
        networks = networks | {HATS: hats(data)}
    changed: dict[tuple[str, float], list[Events]] = {}  # the recordings of the last cell
    for (name, own, *_), cell in keys.items():
        if (name, own, *cell) in known:
            continue
        if cell not in changed:
            changed = {cell: [corrupted(events, *cell, i) for i, events in enumerate(recordings)]}
        right = networks[name](changed[cell]) == truth
        line = {"network": name, "weights": own, "corruption": cell[0], "strength": cell[1]}
        line |= {"accuracy": metrics.accuracy(right), "right": right.astype(int).tolist()}
        journal.add(line)
        known[name, own, *cell] = line
        print(f"{name}, {cell[0]} {cell[1]:g}: {line['accuracy']:.3f}", flush=True)
    return [known[key] for key in keys]


def corrupted(events: Events, name: str, strength: float, number: int) -> Events:
    """Return a recording with a corruption; random numbers depend on its number alone."""
    if name == CLEAN:
        return events
    with deterministic_rng(number, 1):
        return CORRUPTIONS[name].change(events, strength)


def curve(cells: list[dict[str, Any]], network: str, name: str) -> list[tuple[float, Any]]:
    """Return strengths and accuracies of a network, in order of strength; the first or middle one is without effect."""
    none = CORRUPTIONS[name].none
    own = [
        (none if one["corruption"] == CLEAN else one["strength"], one["accuracy"])
        for one in cells
        if one["network"] == network and one["corruption"] in (CLEAN, name)
    ]
    return sorted(own)


def networks_of(cells: list[dict[str, Any]]) -> list[str]:
    return list(dict.fromkeys(one["network"] for one in cells))


def table(cells: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return a row for each corruption and strength, after a head."""
    names = networks_of(cells)
    rows = [("corruption", "strength", *names)]
    for name in CORRUPTIONS:
        for points in zip(*(curve(cells, network, name) for network in names), strict=True):
            rows.append((name, f"{points[0][0]:g}", *(f"{metrics.Accuracy(*found):.3f}" for _, found in points)))
    return rows


def chart(cells: list[dict[str, Any]]) -> np.ndarray:
    """Draw a panel for each corruption, with a line for each network and its intervals."""
    figure = new_figure((1_080, 640))
    for axes, (name, corruption) in zip(figure.subplots(2, 3, sharey=True).flat, CORRUPTIONS.items(), strict=True):
        style_axes(axes, name, corruption.label, "" if axes.get_subplotspec().colspan.start else "accuracy")
        for i, network in enumerate(networks_of(cells)):
            strengths, found = zip(*curve(cells, network, name), strict=True)
            places = np.arange(len(strengths)) + 0.08 * i
            values, lows, highs = zip(*found, strict=True)
            color = LINES[i % len(LINES)]
            axes.vlines(places, lows, highs, color=color, linewidth=2, alpha=0.4)
            axes.plot(places, values, color=color, marker="o", markersize=4, label=network)
            axes.set_xticks(np.arange(len(strengths)), [f"{strength:g}" for strength in strengths])
        axes.set_ylim(0, 1.02)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), fontsize=8, frameon=False)
    return rendered(figure)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--dataset", required=True, choices=sorted(DATASETS), help="dataset")
    add("--root", required=True, type=Path, help="folder or packed store of the recordings")
    add("--out", required=True, type=Path, help="folder for cells.jsonl, robustness.json and robustness.png")
    add("--runs", nargs="+", type=Path, help="folders of trained networks (default: they are trained in OUT)")
    add("--seed", type=int, default=0, help="seed of trainings and of a random split (default 0)")
    text = "fraction of the training recordings for validation, which HATS isn't trained on either (default 0.1)"
    add("--validate", type=float, default=0.1, help=text)
    add("--votes", type=at_least_1, default=5, help="windows of each recording that vote (default 5)")
    add("--epochs", type=at_least_1, help="epochs of trainings (default: that of train_objects.py)")
    return parser.parse_args()


if __name__ == "__main__":
    run(main, "run the command again to continue")
