"""Readers of the recipes' results, for thesis_tables.py: each returns cells of a table of the thesis."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import fmean, pvariance
from typing import Any

from nvsdata.metrics import Accuracy
from nvsdata.metrics.seeds import by_settings, spread

Rows = list[tuple[str, str, str]]
Reader = Callable[[Path], Rows]
# rows of the tables, by the options that select networks
NETWORKS = {
    "gin": "GIN",
    "cheb": "ChebConv",
    "gcn": "GCN",
    "monet": "MoNet",
    "lstm": "LSTM",
    "pointnet": "PointNet",
    "pointnet++": "PointNet++",
    "c3d": "C3D",
    "resnet3d": "ResNet_34",
    "p3d": "P3D_63",
    "r2plus1d": "R2+1D_36",
    "resnext3d": "ResNext_50",
    "i3d": "I3D",
    "plain": "RG-CNN + Plain 3D",
    "inception": "RG-CNN + Incep. 3D(4)",
    "residual": "RG-CNN + Res. 3D",
}


def read(path: Path) -> Any:
    """Return the content of a JSON file."""
    return json.loads(path.read_bytes())


def lines(path: Path) -> list[Any]:
    """Return the lines of a file of JSON lines."""
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


def shown(accuracy: Sequence[float]) -> str:
    """Return an accuracy and its interval as text."""
    return f"{Accuracy(*accuracy):.3f}"


def accuracy(row: str, column: str) -> Reader:
    """Read single-window accuracy from a report."""
    return lambda path: [(row, column, shown(read(path)["accuracy"]["window"]))]


def by_network(reader: Callable[[str], Reader]) -> Reader:
    """Read the row of the network after which the file's folder is named."""
    return lambda path: reader(NETWORKS[path.parent.name])(path)


def by_window(path: Path) -> Rows:
    """Read accuracy by the length of windows from a report."""
    found = read(path)["accuracy_by_window_us"]
    return [(f"{int(length) / 1000:g}", "Accuracy", shown(one)) for length, one in found.items()]


def ablation(setting: str, default: str) -> Reader:
    """Read the mean and deviation over seeds for the default and each value of a setting."""

    def cells(path: Path) -> Rows:
        runs = by_settings(lines(path)[1:], ("one",))
        # names of other runs have several settings
        alone = [name for name in runs if name.startswith(f"{setting} ") and "," not in name]
        names = {name: name.removeprefix(f"{setting} ") for name in alone}
        names |= {"default": default} if "default" in runs else {}
        rows = [(f"{float(value):g}", "Accuracy", spread(runs[name]["one"].values())) for name, value in names.items()]
        return sorted(rows, key=lambda one: float(one[0]))

    return cells


def number_text(value: float) -> str:
    """Return a number as text: two decimals, or none for a whole number."""
    return f"{value:,.0f}" if value == round(value) else f"{value:.2f}"


def complexity(number: str) -> Reader:
    """Read numbers of operations and sizes."""

    def cells(path: Path) -> Rows:
        found = read(path)["tables"][number]
        return [(row, column, number_text(value)) for row, costs in found.items() for column, value in costs.items()]

    return cells


def distances(path: Path) -> Rows:
    """Read distances of distorted events."""
    columns = {"chamfer": "Chamfer", "repeatability": "2.5-Rep.", "emd": "EMD"}
    return [(row["events"], name, f"{row[key]:.2f}") for row in read(path) for key, name in columns.items()]


def settings(path: Path) -> Rows:
    """Read distances of the five settings of PIX2NVS."""
    return [(row, column, f"{value:.3f}") for row, cells in read(path).items() for column, value in cells.items()]


def transfer(path: Path) -> Rows:
    """Read accuracies of real and emulated recordings on both kinds, of voting."""
    rows = []
    for name, found in read(path).items():
        source, target = name.split(" -> ")
        # single windows and votes, or votes alone
        rows.append((f"trained on {source}", f"tested on {target}", shown(found if len(found) == 3 else found[1])))
    return rows


def signs(data: str) -> Reader:
    """Read accuracies on recorded signs, or on other `data`."""
    return lambda path: [(row, f"Accuracy{data}", shown(found)) for row, found in read(path).items()]


def baselines(dataset: str) -> Reader:
    """Read accuracies of all methods, whose names begin with those of the thesis."""

    def cells(path: Path) -> Rows:
        rows = []
        for name, found in read(path).items():
            if isinstance(found, dict):
                method, _, rest = name.partition(" + ")
                row = method if rest in ("", FIRST.get(method, rest)) else name
                rows.append((row, dataset, shown(found["accuracy"])))
        return rows

    return cells


# the classifier of a method that has several in baselines.py
FIRST = {"HOTS": "histogram distance"}


def similarity(row: str, data: str = "") -> Reader:
    """Read mean accuracy and area under the curve over the ten subsets."""

    def cells(path: Path) -> Rows:
        last = lines(path)[-1]
        columns = {f"Acc.{data}": "accuracy", f"AUC{data}": "auc"}
        return [(row, column, f"{last[key]:.3f} ± {last[f'{key}_deviation']:.3f}") for column, key in columns.items()]

    return cells


def scenes(row: str, column: str) -> Reader:
    """Read the accuracy over all left-out recordings, and the variance of the scenes' accuracies."""

    def cells(path: Path) -> Rows:
        by_scene: dict[str, list[bool]] = {}
        for line in lines(path)[1:]:
            for scene, named in zip(line["scenes"], line["named"], strict=True):
                by_scene.setdefault(scene, []).append(scene == named)
        right = [one for answers in by_scene.values() for one in answers]
        if not right:
            return []
        variance = pvariance(map(fmean, by_scene.values()))
        return [
            (row, column, f"{fmean(right):.3f}, {len(right)} recordings"),
            (row, f"{column}, variance", f"{variance:.3f}"),
        ]

    return cells
