"""Count operations and sizes of networks: Tables 4.1 to 4.6, 4.10 and 5.3 of the thesis, and ways to count.

    python recipes/complexity.py --out complexity.json
    python recipes/complexity.py --root recording.aedat4 --out complexity.json
    python recipes/complexity.py --root N-Caltech101 --dataset n-caltech101 --out complexity.json

Operations of graph networks depend on the graphs. They are means over windows of 30 ms that are spread over a recording
of 240x180 pixels (default: `nvsdata.example()`), or over the middle windows of up to 100 recordings of a dataset. They
follow the formulas of the thesis. `--only conventions` compares ways to count with Tables 4.4 and 4.10: "factor" is the
geometric mean of our GFLOPs divided by the published ones, "spread" the standard deviation of the ratios' logarithms. A
way that explains the tables up to the number of edges has a spread near 0.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from thesis_commands import published
from thesis_results import number_text
from thesis_scenes import events_of
from torch import nn

import nvsdata
from nvsdata import Events, models
from nvsdata import transforms as T
from nvsdata.commands.options import path_or_url
from nvsdata.common.files import put
from nvsdata.common.text import aligned
from nvsdata.data.recording import as_events
from nvsdata.datasets import DATASETS
from nvsdata.models import reference
from nvsdata.plots.drawing import middle
from nvsdata.training import run
from nvsdata.transforms.events.sampling import BETA, LITERAL_BETA

SENSOR, CLASSES, HIDDEN = (240, 180), 101, 1024
DEFAULT: dict[str, Any] = {"k": 8, "radius": 3.0, "length": 30_000}
# values of each setting in the tables
SETTINGS: dict[str, tuple[str, tuple[Any, ...]]] = {
    "4.1": ("k", (1, 8, 12)),
    "4.2": ("radius", (1.5, 3.0, 4.5, 6.0)),
    "4.3": ("length", (10_000, 30_000, 50_000, 70_000)),
}
IMAGES = {"VGG_19": reference.VGG, "Inception_V4": reference.InceptionV4, "ResNet_50": reference.ResNet}
VIDEOS: dict[str, tuple[Callable[[int], nn.Module], int]] = {
    "C3D": (reference.C3D, 112),
    "ResNet_34": (reference.ResNet3D, 112),
    "P3D_63": (reference.P3D, 160),
    "R2+1D_36": (reference.R2Plus1D, 112),
    "ResNext_50": (reference.ResNeXt3D, 112),
    "I3D": (reference.I3D, 224),
}
GRAPHS_3D = {"RG-CNN + Plain 3D": "plain", "RG-CNN + Incep. 3D(4)": "inception", "RG-CNN + Res. 3D": "residual"}
INCEPTION_LEAST = 75  # pixels
PARTS, MOST = 5, 100  # windows of a recording; recordings of a dataset
Cost = dict[str, float]


class Layer(NamedTuple):
    """A graph convolution: edges without self-loops, nodes, channels, and cells of the kernel."""

    edges: float
    nodes: float
    inputs: int
    outputs: int
    cells: int


def main() -> None:
    args = arguments()
    windows = Windows(args.root, args.dataset)
    tables = {
        **{number: lambda number=number: by_setting(windows, number) for number in SETTINGS},
        "4.4": lambda: by_depth(windows),
        "4.5": by_kernel,
        "4.6": lambda: of_images((224, 112, 56)),
        "4.10": lambda: {**images(), **objects(windows)},
        "5.3": lambda: {**videos(), **actions(windows)},
        "conventions": lambda: conventions(windows),
    }
    found = {}
    for name in args.only or tables:
        found[name] = tables[name]()
        heads = list(dict.fromkeys(head for row in found[name].values() for head in row))
        rows = [
            [row, *(number_text(values[head]) if head in values else "" for head in heads)]
            for row, values in found[name].items()
        ]
        print(f"\n{aligned([[name, *heads], *rows])}", flush=True)
    put(args.out, json.dumps({"data": windows.about, "tables": found}, indent=1).encode())


class Windows:
    """Windows of events at the same places for each length."""

    def __init__(self, root: Any, dataset: str | None) -> None:
        self.about = f"{dataset or 'recording'} {root}" if root else "nvsdata.example()"
        self._dataset = DATASETS[dataset](root, "all") if dataset else None
        self._events = None if dataset else (nvsdata.example() if root is None else events_of(Path(root)))

    def of(self, length: int) -> Iterator[Events]:
        """Yield windows of `length` µs."""
        if self._dataset is not None:
            for n in np.unique(np.linspace(0, len(self._dataset) - 1, MOST).astype(int)):
                yield middle(as_events(self._dataset[int(n)][0]), length)
        else:
            events = self._events
            for share in (np.arange(PARTS) + 0.5) / PARTS:
                start = events.start + int(share * max(events.duration - length, 0))
                yield events.window(start, start + length)


def graphs(windows: Windows, k: int, radius: float, length: int, beta: float = BETA) -> Iterator[Any]:
    """Yield a graph for each window; random sampling has a fixed seed."""
    torch.manual_seed(0)
    sample = [T.NonUniformSample(k, 1.0, beta)] if k > 1 else []
    transform = T.Compose([*sample, T.RadiusGraph(radius, 1.0, beta)])
    return (transform(window) for window in windows.of(length))


def layers(model: nn.Module, given: list[Any]) -> list[Layer]:
    """Return the graph convolutions of a network, with mean numbers of edges and nodes over the graphs."""
    found: list[list[Layer]] = []

    def note(layer: Any, inputs: Any, _: Any) -> None:
        x, (source, target), _ = inputs
        cells, into, out = layer.weight.shape
        found[-1].append(Layer(int((source != target).sum()), x.shape[0], into, out, cells))

    convolutions = [layer for layer in model.modules() if isinstance(layer, models.SplineConv)]
    hooks = [layer.register_forward_hook(note) for layer in convolutions]
    with torch.no_grad():
        for graph in given:
            found.append([])
            model.eval()(graph)
    for hook in hooks:
        hook.remove()
    return [
        Layer(np.mean([one.edges for one in same]), np.mean([one.nodes for one in same]), *same[0][2:])
        for same in zip(*found, strict=True)
    ]


def printed(layer: Layer) -> float:
    """Return the FLOPs of equation 4.12: degree m = 1, d = 2 pseudo-coordinates."""
    taps = 4
    return layer.edges * taps * (3 * layer.inputs * layer.outputs + 14) + (layer.edges + layer.nodes) * layer.outputs


def with_factor(factor: int) -> Callable[[Layer], float]:
    """Return equation 4.12 with another number of operations per weight than 3."""
    return lambda layer: printed(layer) + (factor - 3) * 4 * layer.edges * layer.inputs * layer.outputs


WAYS: dict[str, Callable[[Layer], float]] = {
    "equation 4.12": printed,
    "a multiply-add is 2": with_factor(2),
    "a multiply-add is 1": with_factor(1),
    "all cells of the kernel": lambda one: printed(one) + 3 * (one.cells - 4) * one.edges * one.inputs * one.outputs,
    "self-loops are edges": lambda one: printed(one._replace(edges=one.edges + one.nodes)),
    "an edge has two ends": lambda one: printed(one._replace(edges=one.edges / 2)),
    "32 edges per node": lambda one: printed(one._replace(edges=32 * one.nodes)),
}


def fully_connected(inputs: int) -> int:
    """Return the FLOPs of FC(1024) and FC(101), (2I - 1) O each."""
    return (2 * inputs - 1) * HIDDEN + (2 * HIDDEN - 1) * CLASSES


def network(depth: int, *, residual: bool = False, kernel_size: int = 5) -> nn.Module:
    """Return the graph network of a row of Table 4.4."""
    kind = models.RGCNN if residual else models.GCNN
    return kind(CLASSES, sensor_size=SENSOR, hidden=HIDDEN, kernel_size=kernel_size, **models.DEPTHS[depth])


def conventions(windows: Windows) -> dict[str, Cost]:
    """Return GFLOPs of Tables 4.4 and 4.10 by each way to count, and their ratios to the thesis."""
    thesis = {f"depth {depth}": published("4.4", depth, "GFLOPs") for depth in models.DEPTHS}
    thesis |= {"RG-CNN": published("4.10", "RG-CNNs", "GFLOPs")}
    found = {"thesis": dict(thesis)}
    for beta, name in ((BETA, ""), (LITERAL_BETA, "; beta = 5e-6")):
        given = list(graphs(windows, **DEFAULT, beta=beta))
        parts = {f"depth {depth}": layers(network(depth), given) for depth in models.DEPTHS}
        parts["RG-CNN"] = layers(network(4, residual=True), given)
        for way, count in WAYS.items() if not name else [("equation 4.12", printed)]:
            for cells, last in ((1, "FC of channels"), (16, "FC of 16 cells")):
                sums = {
                    row: (sum(map(count, part)) + fully_connected(cells * part[-1].outputs)) / 1e9
                    for row, part in parts.items()
                }
                found[f"{way}{name}; {last}"] = sums | compared(sums, thesis)
        every = [one._replace(edges=part[0].edges, nodes=part[0].nodes) for part in parts.values() for one in part]
        at = iter(every)
        sums = {row: sum(printed(next(at)) for _ in part) / 1e9 for row, part in parts.items()}
        found[f"all layers at full resolution{name}"] = sums | compared(sums, thesis)
    return found


def compared(sums: Cost, thesis: Cost) -> Cost:
    """Return the geometric mean of ratios to the thesis, and the standard deviation of their logarithms."""
    logs = np.log([sums[row] / thesis[row] for row in thesis])
    return {"factor": float(np.exp(logs.mean())), "spread": float(logs.std())}


def by_setting(windows: Windows, number: str) -> dict[str, Cost]:
    """Return mean GFLOPs of G-CNN, nodes and edges for each value of a setting."""
    name, values = SETTINGS[number]
    model, found = network(4), {}
    for value in values:
        given = list(graphs(windows, **DEFAULT | {name: value}))
        row = f"{value / 1000:g}" if name == "length" else f"{value:g}"
        found[row] = {
            "GFLOPs": of_graphs(model, given)["GFLOPs"],
            "nodes": round(np.mean([graph.num_nodes for graph in given])),
            "edges": round(np.mean([graph.num_edges for graph in given])),
        }
    return found


def of_graphs(model: nn.Module, given: list[Any]) -> Cost:
    """Return mean GFLOPs, and the size in MiB, by the thesis's formulas."""
    costs = [models.complexity(model, graph) for graph in given]
    return {"GFLOPs": float(np.mean([cost.flops for cost in costs])) / 1e9, "Size (MB)": costs[0].size}


def by_depth(windows: Windows) -> dict[str, Cost]:
    """Return GFLOPs and sizes of the networks of Table 4.4."""
    given = list(graphs(windows, **DEFAULT))
    return {str(depth): of_graphs(network(depth), given) for depth in models.DEPTHS}


def objects(windows: Windows) -> dict[str, Cost]:
    """Return GFLOPs and sizes of the graph networks of Table 4.10."""
    given = list(graphs(windows, **DEFAULT))
    return {name: of_graphs(network(4, residual=name[0] == "R"), given) for name in ("G-CNNs", "RG-CNNs")}


def by_kernel() -> dict[str, Cost]:
    """Return the sizes of Table 4.5; equation 4.12 doesn't depend on the kernel size."""
    graph = T.RadiusGraph()(nvsdata.example().window(0, 1_000))
    sizes = {size: models.complexity(network(4, kernel_size=size), graph).size for size in (2, 3, 4, 5, 6)}
    return {str(size): {"Size (MB)": found} for size, found in sizes.items()}


def of_images(sides: tuple[int, ...]) -> dict[str, Cost]:
    """Return the GFLOPs of Table 4.6, where a multiply-add is one operation, for the sizes that a network takes."""
    found = {}
    for side, (name, kind) in product(sides, IMAGES.items()):
        if name != "Inception_V4" or side >= INCEPTION_LEAST:
            found[f"{name}, {side}x{side}"] = {"GFLOPs": of_frames(kind, (side, side))[0]}
    return found


def images() -> dict[str, Cost]:
    """Return the costs of the CNNs of Table 4.10, whose "MB" are millions of weights."""
    sides = {name: 299 if name == "Inception_V4" else 224 for name in IMAGES}
    costs = {name: of_frames(kind, (sides[name],) * 2) for name, kind in IMAGES.items()}
    return {name: {"GFLOPs": flops, "Size (MB)": size} for name, (flops, size) in costs.items()}


def of_frames(kind: Callable[[int], nn.Module], shape: tuple[int, ...]) -> tuple[float, float]:
    """Return 10^9 multiply-adds, and millions of weights, for an input of two channels, without computing anything."""
    with torch.device("meta"):
        cost = models.complexity(kind(CLASSES), torch.zeros(1, 2, *shape))
    return cost.flops / 2e9, cost.parameters / 1e6


def videos() -> dict[str, Cost]:
    """Return the costs of the 3D CNNs of Table 5.3, with 16 frames."""
    costs = {name: of_frames(kind, (16, side, side)) for name, (kind, side) in VIDEOS.items()}
    return {name: {"FLOPs (10^9)": flops, "#params (10^6)": size} for name, (flops, size) in costs.items()}


def actions(windows: Windows) -> dict[str, Cost]:
    """Return the costs of the graph networks of Table 5.3: 16 graphs of a window each."""
    found = {}
    every = [T.KNNGraph()(window) for window in windows.of(33_333)]
    batch, _ = nvsdata.collate([([every[n % len(every)] for n in range(16)], 0)])
    for name, temporal in GRAPHS_3D.items():
        cost = models.complexity(models.rgcnn3d("ucf101-dvs", temporal), batch)
        found[name] = {"FLOPs (10^9)": cost.flops / 2e9, "#params (10^6)": cost.parameters / 1e6}
    return found


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--out", type=Path, required=True, help="JSON file for the numbers")
    add("--root", type=path_or_url, help="recording, or folder or store of --dataset (default: nvsdata.example())")
    add("--dataset", choices=sorted(DATASETS), help="kind of --root (default: a single recording)")
    names = (*SETTINGS, "4.4", "4.5", "4.6", "4.10", "5.3", "conventions")
    add("--only", nargs="+", choices=names, help="tables (default: all)")
    return parser.parse_args()


if __name__ == "__main__":
    run(main, "run the command again")
