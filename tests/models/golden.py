"""What every network gives for fixed weights and a fixed input.

    python tests/models/golden.py

computes golden.json again and prints what changed. Whoever changes it on purpose says in the commit why.
Processors differ in the last digits of a score: what is within the tolerance stays as it was kept.
Weights and inputs are made of PCG64's raw numbers, whose stream numpy guarantees, and depend on nothing else.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from nvsdata import Graph, GraphBatch, models
from nvsdata.models import reference
from nvsdata.models.distributed import Dropout

PATH = Path(__file__).with_suffix(".json")
KEPT = 5  # scores of a sample
TOLERANCE = 1e-5  # of the largest score: those of other instruction sets differ by up to 1.6e-6 of it


def uniform(name: str, *shape: int) -> np.ndarray:
    """Numbers from [-1, 1) that depend on the name alone, float64."""
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8])
    count = math.prod(shape)
    raw = np.random.PCG64(seed).random_raw((count + 1) // 2).view(np.uint32)[:count]
    return (raw / 2.0**31 - 1).reshape(shape)


def fill(model: torch.nn.Module) -> torch.nn.Module:
    """Give a network weights and running statistics by their names, such that values neither vanish nor explode."""
    with torch.no_grad():
        for name, value in model.state_dict().items():
            if value.is_floating_point():
                value.copy_(torch.as_tensor(_values(name, uniform(name, *value.shape))))
            else:
                value.zero_()
    return model.eval()


def _values(name: str, u: np.ndarray) -> np.ndarray:
    last = name.rpartition(".")[2]
    if last == "deviation":  # of MoNet's Gaussians, whose means are in [0, 1] as pseudo-coordinates are
        return 0.5 + 0.2 * u
    if last == "mean":
        return 0.5 + 0.5 * u
    if u.shape == (1,):  # slope of a parametric ReLU
        return 0.25 + 0.1 * u
    if u.ndim < 2:
        return 1 + 0.3 * u if last in ("weight", "running_var") else 0.3 * u
    spline = u.ndim == 3 and name.endswith(("conv.weight", "shortcut.weight"))
    inputs = u.shape[1] if spline else u.shape[0] if last == "root" else math.prod(u.shape[1:])
    return u * math.sqrt(6 / inputs)


def graph(number: int, sensor_size: tuple[int, int], *, nodes: int = 90, features: int = 1, kind: str = "signed"):
    """Nodes in clouds of 12 pixels across, each with an edge from its three nearest."""
    width, height = sensor_size
    center = uniform(f"centers {number}", 6, 2)[np.arange(nodes) % 6]
    spread = uniform(f"nodes {number}", nodes, 2) * 6
    pos = np.floor((center * 0.8 + 1) / 2 * (width, height) + spread).clip(0, (width - 1, height - 1))
    t = np.arange(nodes) * 100
    x = np.where(uniform(f"features {number}", nodes, features) < 0, -1.0, 1.0)
    apart = ((pos[:, None] - pos) ** 2).sum(2) + 1e9 * np.eye(nodes)
    source = np.argsort(apart, axis=1, kind="stable")[:, :3].ravel()
    target = np.repeat(np.arange(nodes), 3)
    share = np.column_stack((pos[source] - pos[target], t[source] - t[target])) / (4.0, 4.0, 4_096.0)
    u = np.abs(share[:, :2]) if kind == "abs" else (share[:, : 3 if kind == "signed-time" else 2] + 1) / 2
    reach = (4.0, 4.0, 4_096.0)[: u.shape[1]]
    edges = torch.from_numpy(np.stack((source, target)))
    x, pos, u = (torch.from_numpy(values).float() for values in (x, pos, u.clip(0, 1)))
    return Graph(x, pos, torch.from_numpy(t), edges, u, sensor_size=sensor_size, reach=reach, pseudo=kind)


def graphs(sensor_size: tuple[int, int], **options: Any) -> GraphBatch:
    """Two graphs."""
    return GraphBatch.from_graphs([graph(n, sensor_size, **options) for n in range(2)])


def sequences(sensor_size: tuple[int, int], count: int = 2, volumes: int = 2, **options: Any) -> GraphBatch:
    """Sequences of graphs."""
    made = [graph(n, sensor_size, **options) for n in range(count * volumes)]
    return GraphBatch.from_graphs(made, volumes=volumes)


def pictures(*shape: int) -> torch.Tensor:
    """Two samples [C, ...] of blots 8 pixels wide, and noise; the second is brighter."""
    values = uniform("blots", 2, shape[0], *(-(-side // 8) for side in shape[1:]))
    for axis, side in enumerate(shape[1:], 2):
        values = values.repeat(8, axis).take(range(side), axis)
    values = 2 * values + uniform("noise", 2, *shape)
    values[1] += 1
    return torch.from_numpy(values).float()


def points(count: int) -> torch.Tensor:
    """Two samples of events with x, y and t in [0, 1] and polarity, in order of time."""
    values = uniform("points", 2, count, 4)
    values[..., :3] = (values[..., :3] + 1) / 2
    values[..., 2].sort(1)
    values[..., 3] = np.where(values[..., 3] < 0, -1, 1)
    return torch.from_numpy(values).float()


@dataclass(frozen=True)
class Case:
    """A network and its input, None for one of which only names and shapes of the weights are kept."""

    build: Callable[[], torch.nn.Module]
    given: Callable[[], Any] | None = None


N_MNIST = models.CONFIGURATIONS["n-mnist"]
DEPTH = {"num_classes": 24, "sensor_size": (240, 180), "hidden": 1024}
KINDS = {"rgcnn": models.RGCNN, "gcnn": models.GCNN}
CASES: dict[str, Case] = {
    **{f"{name} by default": Case(partial(kind, 10)) for name, kind in models.NETWORKS.items()},
    **{
        f"{name} {configuration}": Case(partial(kind, **settings), partial(graphs, settings["sensor_size"]))
        for name, kind in KINDS.items()
        for configuration, settings in models.CONFIGURATIONS.items()
    },
    **{
        f"{name} of depth {depth}": Case(partial(kind, **DEPTH | settings), partial(graphs, (240, 180)))
        for name, kind in KINDS.items()
        for depth, settings in models.DEPTHS.items()
    },
    **{
        f"{name} of depth {depth} for 34x34": Case(partial(kind, **N_MNIST | settings), partial(graphs, (34, 34)))
        for name, kind in KINDS.items()
        for depth, settings in models.SMALL_DEPTHS.items()
        if depth > 3
    },
    **{
        f"{name} {setting} {value}": Case(partial(kind, **N_MNIST, **{setting: value}), partial(graphs, (34, 34)))
        for name, kind in KINDS.items()
        for setting, value in (("pooling", "average"), ("loops", False), ("root_weight", False), ("kernel_size", 3))
    },
    **{
        f"gcnn {name}": Case(partial(models.GCNN, **N_MNIST, convolution=name), partial(graphs, (34, 34)))
        for name in models.CONVOLUTIONS
    },
    "rgcnn gcn": Case(partial(models.RGCNN, **N_MNIST, convolution="gcn"), partial(graphs, (34, 34))),
    "rgcnn abs": Case(partial(models.RGCNN, **N_MNIST), partial(graphs, (34, 34), kind="abs")),
    "rgcnn in time": Case(
        partial(models.RGCNN, **N_MNIST, dim=3, kernel_size=3, in_channels=2),
        partial(graphs, (34, 34), kind="signed-time", features=2),
    ),
    **{
        f"rgcnn3d {configuration} {temporal}": Case(
            partial(models.RGCNN3D, **settings, temporal=temporal),
            partial(sequences, settings["sensor_size"], volumes=4 if configuration == "dvs128-gesture" else 2),
        )
        for configuration, settings in models.CONFIGURATIONS_3D.items()
        for temporal in models.TEMPORAL
    },
    "rgcnn3d average": Case(
        partial(models.RGCNN3D, 3, temporal="plain", clusters=((8, 6), (16, 12), (60, 45)), pooling="average"),
        partial(sequences, (240, 180), volumes=8),
    ),
    "vgg": Case(partial(reference.VGG, 10, hidden=64), partial(pictures, 2, 64, 64)),
    "vgg of 16 layers": Case(partial(reference.VGG, 10, layers=16, hidden=64), partial(pictures, 2, 32, 32)),
    "inception-v4": Case(partial(reference.InceptionV4, 10), partial(pictures, 2, 75, 75)),
    "resnet": Case(partial(reference.ResNet, 10), partial(pictures, 2, 64, 64)),
    "c3d": Case(partial(reference.C3D, 10, hidden=64), partial(pictures, 2, 8, 32, 32)),
    "i3d": Case(partial(reference.I3D, 10), partial(pictures, 2, 8, 32, 32)),
    "resnet3d": Case(partial(reference.ResNet3D, 10), partial(pictures, 2, 8, 32, 32)),
    "p3d": Case(partial(reference.P3D, 10), partial(pictures, 2, 8, 32, 32)),
    "r2plus1d": Case(partial(reference.R2Plus1D, 10), partial(pictures, 2, 8, 32, 32)),
    "resnext3d": Case(partial(reference.ResNeXt3D, 10), partial(pictures, 2, 8, 32, 32)),
    "motion-vector-3d": Case(
        partial(reference.MotionVector3D, 10, frames=20, size=12, hidden=64), partial(pictures, 20, 12, 12)
    ),
    "pointnet": Case(partial(reference.PointNet, 10), partial(points, 60)),
    "pointnet++": Case(partial(reference.PointNet2, 10), partial(points, 600)),
    "lstm": Case(partial(reference.LSTM, 10), partial(points, 20)),
}


def built(case: Case, device: str = "cpu") -> torch.nn.Module:
    """The network of a case, with the weights of `fill`; on "meta" without any."""
    with torch.device("meta"):
        model = case.build()
    # drawing weights first would take longer than all the rest
    return model if device == "meta" else fill(model.to_empty(device=device))


@torch.no_grad()
def scores_of(case: Case) -> torch.Tensor:
    """What the network of a case gives, [2, num_classes]."""
    assert case.given is not None
    return built(case)(case.given())


def weights_of(case: Case) -> dict[str, Any]:
    """Of a case's network: number of parameters, hash of the names and shapes of all that it keeps, dropout."""
    model = built(case, "meta")
    listed = "\n".join(f"{name} {tuple(value.shape)}" for name, value in model.state_dict().items())
    return {
        "parameters": sum(parameter.numel() for parameter in model.parameters()),
        "hash": hashlib.sha256(listed.encode()).hexdigest()[:16],
        "dropout": [part.p for part in model.modules() if isinstance(part, Dropout)],
    }


def summary(scores: torch.Tensor) -> list[list[float]]:
    """Of each sample: its first scores, then mean and standard deviation of all."""
    wide = scores.double()
    return [[*one[:KEPT].tolist(), one.mean().item(), one.std(correction=0).item()] for one in wide]


def record(case: Case) -> dict[str, Any]:
    """What golden.json keeps of a case."""
    kept: dict[str, Any] = weights_of(case)
    if case.given is not None:
        kept["scores"] = [[float(f"{value:.8g}") for value in one] for one in summary(scores_of(case))]
    return kept


def agree(before: dict[str, Any] | None, now: dict[str, Any]) -> bool:
    """Whether a case is as it was, its scores within the tolerance."""
    if before is None or before.keys() != now.keys():
        return False
    if any(before[key] != now[key] for key in now if key != "scores"):
        return False
    was, found = (np.array(one.get("scores", [[0.0]])) for one in (before, now))
    return was.shape == found.shape and bool(np.abs(was - found).max() <= TOLERANCE * np.abs(was).max())


def main() -> None:
    before = json.loads(PATH.read_text()) if PATH.exists() else {}
    now = {name: record(case) for name, case in CASES.items()}
    now = {name: before[name] if agree(before.get(name), found) else found for name, found in now.items()}
    for name in before | now:
        if before.get(name) != now.get(name):
            print(f"{name}:\n  was {before.get(name)}\n  is  {now.get(name)}")
    PATH.write_text("{\n" + ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in now.items()) + "\n}\n")


if __name__ == "__main__":
    main()
