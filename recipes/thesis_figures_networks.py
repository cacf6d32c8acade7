"""Figures of networks and results of the thesis, for thesis_figure.py: 4.2, 4.6, 5.2 and 5.4."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from compare_runs import read, scores_of
from thesis_figures_events import Drawn
from thesis_scenes import STATIC, letter_events, pairs_of
from torch import nn

import nvsdata
from nvsdata import GraphBatch, models
from nvsdata import transforms as T
from nvsdata.datasets import DATASETS
from nvsdata.metrics import area_under_roc, roc
from nvsdata.models.blocks import Residual, Streams
from nvsdata.models.graph_cnn import Activation, ConvBlock, ResidualBlock
from nvsdata.models.grid import Graph2GridLayer
from nvsdata.models.pool import GraphPool
from nvsdata.models.temporal import Conv3D
from nvsdata.plots.axes import CURVES, new_chart, new_figure
from nvsdata.training.report import SCORES

OBJECTS = ("n-mnist", "n-caltech101", "mnist-dvs", "cifar10-dvs", "n-cars", "asl-dvs")
RECORDED = 8  # recordings of each drawn letter
PER_ROW = 6  # boxes in a row of a diagram


class Box(NamedTuple):
    """A layer of a diagram: its name, what it returned, and its number of weights."""

    name: str
    output: str
    weights: int


def figure_4_2(args: argparse.Namespace) -> Drawn:
    """Draw the layers of RG-CNN, or of the network of a run."""
    model, graph, about = network_and_graph(args)
    caption = f"Data: one graph of {about}. The thesis draws sampling, graph and network as symbols, without shapes."
    return diagram(boxes(model, graph)), caption


def figure_5_2(args: argparse.Namespace) -> Drawn:
    """Draw the layers of RG-CNN + 3D CNN."""
    model, windows = models.rgcnn3d("ucf101-dvs", "plain").eval(), T.RandomWindows(8)
    graphs = [T.KNNGraph()(part) for part in windows(nvsdata.example())]
    batch, _ = nvsdata.collate([(graphs, 0)])
    caption = (
        "Data: S = 8 graphs of the example scene, Plain 3D, 101 classes. The thesis draws symbols, without shapes."
    )
    return diagram(boxes(model, batch)), caption


def network_and_graph(args: argparse.Namespace) -> tuple[nn.Module, Any, str]:
    """Return a network, a graph for it, and words on the graph. ValueError if the run's network takes no graphs."""
    events = nvsdata.example().window(200_000, 230_000)
    if not args.run:
        return (
            models.rgcnn("n-caltech101").eval(),
            T.Compose([T.NonUniformSample(8), T.RadiusGraph()])(events),
            ("30 ms of the example scene, 101 classes"),
        )
    trained = models.load(args.run[0] / "model.safetensors")
    if not isinstance(trained.model, models.RGCNN | models.GCNN) or trained.transform is None:
        raise ValueError(f"{args.run[0]} has no network of graphs of objects")
    width, height = trained.model.sensor_size
    fitted = T.Compose([T.Resize(min(width, height)), T.CenterCrop(min(width, height))])(nvsdata.example())
    return trained.model, trained.transform(fitted), f"the example scene, for the network of {args.run[0].name}"


def boxes(model: nn.Module, graph: Any) -> list[Box]:
    """Run a network, and return its layers in order, with the shapes of what they returned."""
    found: list[Box] = []

    def note(layer: nn.Module, inputs: Any, output: Any) -> None:
        # what a fully connected layer takes isn't what the layer before returned: cells or means come in between
        before = f"{shape_of(inputs[0])} to " if isinstance(layer, nn.Linear) else ""
        found.append(Box(layer_name(layer), before + shape_of(output), sum(p.numel() for p in layer.parameters())))

    hooks = [layer.register_forward_hook(note) for layer in layers_of(model)]
    try:
        with torch.no_grad():
            model(graph)
    finally:
        for hook in hooks:
            hook.remove()
    batch = graph if isinstance(graph, GraphBatch) else GraphBatch.of(graph)
    return [Box("graph" if batch.num_graphs == 1 else f"{batch.num_graphs} graphs", shape_of(batch), 0), *found]


def layers_of(model: nn.Module) -> Iterator[nn.Module]:
    """Yield the layers of a network that a diagram shows."""
    for child in model.children():
        if type(child) is nn.Sequential:
            yield from layers_of(child)
        elif not isinstance(child, Activation):
            yield child


def layer_name(layer: nn.Module) -> str:
    """Return the name of a layer in the notation of the thesis."""
    if isinstance(layer, ConvBlock | ResidualBlock):
        cells, channels, out = layer.conv.weight.shape
        side = round(cells ** (1 / layer.kernel.dim))
        return f"{'Conv' if isinstance(layer, ConvBlock) else 'Res_g'}({channels}, {out})\n{side}x{side}"
    if isinstance(layer, GraphPool):
        return "MaxP {}x{}".format(*layer.cluster)
    if isinstance(layer, Conv3D):
        return f"Conv3D({layer[0].in_channels}, {layer[0].out_channels})\n3x3x3"
    if isinstance(layer, nn.Linear):
        return f"FC({layer.out_features})"
    names = {nn.MaxPool3d: "Pool3D", Residual: "Res3D", Streams: "Inc3D", Graph2GridLayer: "Graph2Grid"}
    return next((name for kind, name in names.items() if isinstance(layer, kind)), type(layer).__name__)


def shape_of(output: Any) -> str:
    """Return the size of what a layer returned."""
    if isinstance(output, torch.Tensor):
        return "[" + ", ".join(map(str, output.shape)) + "]"
    return f"{output.num_nodes:,} nodes x {output.x.shape[1]}\n{output.num_edges:,} edges"


def diagram(found: list[Box]) -> Any:
    """Return a figure of boxes from left to right, row by row, with what goes from one to the next below each."""
    from matplotlib.patches import FancyBboxPatch

    rows = -(-len(found) // PER_ROW)
    figure = new_figure((1250, 150 * rows + 50))
    axes = figure.add_subplot()
    axes.set(xlim=(-0.55, PER_ROW - 0.4), ylim=(-rows + 0.35, 0.55))
    axes.set_axis_off()
    for n, box in enumerate(found):
        x, y = n % PER_ROW, -(n // PER_ROW)
        color = colors_of(box)
        axes.add_patch(
            FancyBboxPatch(
                (x - 0.36, y - 0.16), 0.72, 0.42, boxstyle="round,pad=0.02", facecolor=(*color, 0.25), edgecolor=color
            )
        )
        axes.text(x, y + 0.05, box.name, ha="center", va="center", fontsize=10)
        weights = f"\n{box.weights:,} weights" if box.weights else ""
        axes.text(x, y - 0.21, box.output + weights, ha="center", va="top", fontsize=7.5)
        if n + 1 < len(found):
            arrow = {"arrowstyle": "->", "color": "0.4"}
            if (n + 1) % PER_ROW:
                axes.annotate("", (x + 0.6, y + 0.05), (x + 0.4, y + 0.05), arrowprops=arrow)
            else:
                axes.text(x + 0.42, y + 0.05, "...", va="center", fontsize=12, color="0.4")
    return figure


def colors_of(box: Box) -> tuple[float, float, float]:
    """Return the color of a layer: input, convolution, fully connected, and others without weights."""
    if box.name.startswith("FC"):
        return CURVES[1]
    return CURVES[0] if box.weights else CURVES[4]


def figure_4_6(args: argparse.Namespace) -> Drawn:
    """Draw the numbers of classes and recordings of the datasets of objects."""
    figure, axes = new_chart((760, 520), "", "number of classes", "number of recordings")
    for name in OBJECTS:
        info = DATASETS[name].info
        own = name == "asl-dvs"
        axes.plot(len(info.classes), info.recordings, "s" if own else "o", color=CURVES[1 if own else 0], markersize=9)
        axes.annotate(
            f"{name}: {info.recordings:,}",
            (len(info.classes), info.recordings),
            (0, 9),
            textcoords="offset points",
            ha="center",
            fontsize=9,
        )
    axes.set(xscale="log", yscale="log", xlim=(1.3, 250), ylim=(5_000, 250_000))
    axes.set_xticks([2, 5, 10, 24, 50, 101], ["2", "5", "10", "24", "50", "101"])
    axes.set_yticks([10_000, 30_000, 100_000], ["10,000", "30,000", "100,000"])
    axes.minorticks_off()
    return (
        figure,
        "Data: the numbers in nvsdata's registry; N-Caltech101 is without the class Faces. Both axes are logarithmic.",
    )


def figure_5_4(args: argparse.Namespace) -> Drawn:
    """Draw ROC curves of the decision whether two recordings are of one class."""
    if args.run:
        lines = [(folder.name, *of_run(folder)) for folder in args.run]
        caption = (
            "Data: pairs of the runs' test recordings; the score is the probability of one class by both predictions."
        )
    else:
        lines = list(of_letters())
        caption = (
            "Data: pairs of drawn letters recorded by a simulated camera; scores are cosines (no. 7 of Table 5.4)."
            " Pass --run for networks."
        )
    figure, axes = new_chart((680, 620), "", "false positive rate", "true positive rate")
    axes.plot((0, 1), (0, 1), color="0.8", linestyle="--", label="random")
    for n, (name, scores, same) in enumerate(lines):
        area = area_under_roc(scores, same)
        axes.plot(*roc(scores, same), color=CURVES[n % len(CURVES)], label=f"{name}, AUC {area:.3f}")
    axes.set(xlim=(0, 1), ylim=(0, 1.01), aspect="equal")
    axes.legend(loc="lower right", fontsize=9)
    return figure, f"{caption} The thesis has networks on ASLAN-DVS."


def of_run(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return scores of pairs of a run's test recordings, and whether each pair has one class."""
    rows = read(folder)
    scores, targets = scores_of(folder / SCORES, rows, list(rows))
    total = scores.sum(0)
    odds = np.exp(total - total.max(1, keepdims=True))
    probabilities = odds / odds.sum(1, keepdims=True)
    pairs, same = pairs_of(targets)
    return np.einsum("pc,pc->p", probabilities[pairs[:, 0]], probabilities[pairs[:, 1]]), same


def of_letters() -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield the name of a feature, scores of pairs of recordings of letters, and whether each pair has one letter."""
    labels = np.repeat(np.arange(len(STATIC)), RECORDED)
    events = [letter_events(STATIC[label], seed) for seed, label in enumerate(labels)]
    pairs, same = pairs_of(labels)
    features = {"event counts": T.EventImage(), "time surface": T.TimeSurface(), "HATS": T.HATS()}
    for name, transform in features.items():
        rows = np.stack([np.asarray(transform(one), np.float64).ravel() for one in events])
        rows /= np.linalg.norm(rows, axis=1, keepdims=True)
        yield name, np.einsum("pd,pd->p", rows[pairs[:, 0]], rows[pairs[:, 1]]), same
