"""Networks with fixed weights, and batches as their input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import torch
from torch import nn

from nvsdata import models
from nvsdata import transforms as T
from nvsdata.benchmarks.case import Options
from nvsdata.benchmarks.inputs import WINDOW, digits, outlines
from nvsdata.data.batching import collate
from nvsdata.data.graph import GraphBatch
from nvsdata.models.distributed import Dropout
from nvsdata.transforms.events.crops import resize_events

VOLUMES = 4  # graphs per sequence

# every configuration of the thesis: function that builds the network, sensor size, whether it takes sequences
NETWORKS: dict[str, tuple[Callable[[], nn.Module], tuple[int, int], bool]] = {
    **{
        f"{kind} {name}": (partial(make, name), settings["sensor_size"], False)
        for kind, make in (("RG-CNN", models.rgcnn), ("G-CNN", models.gcnn))
        for name, settings in models.CONFIGURATIONS.items()
    },
    **{
        f"RG-CNN + {temporal} 3D {name}": (partial(models.rgcnn3d, name, temporal), settings["sensor_size"], True)
        for name, settings in models.CONFIGURATIONS_3D.items()
        for temporal in ("plain", "inception", "residual")
    },
}


def fixed_network(make: Callable[[], nn.Module], device: str = "cpu") -> nn.Module:
    """Build a network with the same random weights each time.

    Dropout is off. Weights and statistics of batch normalization are random, so that it isn't the identity.
    """
    torch.manual_seed(0)
    model = make()
    for module in model.modules():
        if isinstance(module, Dropout | nn.Dropout):
            module.p = 0.0
        elif isinstance(module, models.BatchNorm):
            nn.init.uniform_(module.weight, 0.5, 1.5)
            nn.init.uniform_(module.bias, -0.5, 0.5)
            nn.init.uniform_(module.get_buffer("running_mean"), -0.5, 0.5)
            nn.init.uniform_(module.get_buffer("running_var"), 0.5, 2)
    return model.to(device)


def digit_batch(options: Options, count: int) -> tuple[GraphBatch, torch.Tensor]:
    """Return a batch of graphs of 30 ms windows of digits, and targets [count]."""
    found, recordings = [], digits(options)
    for n in range(count):
        events = recordings[n % len(recordings)]
        start = events.start + 1_000 * n % max(events.duration - WINDOW, 1)
        found.append((T.RadiusGraph()(events.window(start, start + WINDOW)), n % 10))
    batch, targets = collate(found)
    return batch.to(options.device), targets.to(options.device)


def sample_batch(sensor_size: tuple[int, int], sequences: bool) -> GraphBatch:
    """Return a batch of two graphs, or of two sequences of graphs, of moving squares, on the CPU."""
    made = []
    for seed in range(2 * (VOLUMES if sequences else 1)):
        events = resize_events(outlines(1_000, seed=seed), *sensor_size)
        made.append(T.RadiusGraph(max_degree=8)(events))
    return GraphBatch.from_graphs(made, volumes=VOLUMES if sequences else 1)


def in_float64(batch: GraphBatch) -> GraphBatch:
    """Convert features, positions and pseudo-coordinates of a batch to float64."""
    return replace(batch, x=batch.x.double(), pos=batch.pos.double(), edge_attr=batch.edge_attr.double())


def synchronize(device: str) -> None:
    """Wait until a GPU has finished its work; do nothing for the CPU."""
    if device != "cpu":
        torch.cuda.synchronize()
