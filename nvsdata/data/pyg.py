"""Graphs of PyTorch Geometric: check of a `Data` or `Batch`, and its conversion to the fields of a `Graph`.

This module doesn't import torch_geometric, because a program that has a `Data` has imported it already.
"""

from __future__ import annotations

import sys
from collections.abc import Collection
from typing import Any

import torch

from nvsdata.data.pseudo import check_pseudo

NEEDED = ("x", "pos", "edge_index")


def is_pyg(sample: object) -> bool:
    """Return whether `sample` is a `torch_geometric.data.Data` or `Batch`."""
    kind = getattr(sys.modules.get("torch_geometric.data"), "Data", ())
    return isinstance(sample, kind)


def fields_of(data: Any, names: Collection[str]) -> dict[str, Any]:
    """Return the fields of a `Graph` or `GraphBatch` that `data` has, checked and converted.

    Edges are grouped by target. `t` is 0 if there are no times. Missing fields have no entry.

    Args:
        data: A `Data` or `Batch`.
        names: Names of all fields. If `batch` is one of them, `batch` and `ptr` are computed; otherwise `data` must be
            a single graph.

    Raises:
        ValueError: If a necessary field is missing, has another shape, or contradicts another field.
    """
    found = {name: data[name] for name in names if name in data and data[name] is not None}
    if missing := [name for name in NEEDED if name not in found]:
        kind = type(data).__name__
        raise ValueError(f"a graph needs {', '.join(NEEDED)}; this {kind} has no {' and '.join(missing)}")
    if getattr(data, "batch", None) is not None and "batch" not in names:
        raise ValueError(f"this {type(data).__name__} is a batch of graphs: use GraphBatch.from_pyg")
    found |= _settings(found)
    found |= _nodes(found) | _edges(found)
    if "batch" in names:
        found |= _membership(data, found)
    return found


def _settings(found: dict[str, Any]) -> dict[str, Any]:
    """Return the fields that aren't tensors. In a batch of PyG, such a field is a list with an entry for each graph."""
    settings: dict[str, Any] = {}
    for name in found.keys() - {*NEEDED, "t", "edge_attr", "y", "batch", "ptr"}:
        value = found[name]
        if isinstance(value, torch.Tensor):
            raise ValueError(f"{name} must be numbers or strings, not a tensor {list(value.shape)}")
        each = value if isinstance(value, list) and value and isinstance(value[0], tuple | list | str) else [value]
        each = [tuple(one) if isinstance(one, list) else one for one in each]
        if name == "sensor_size":
            each = [(max(int(w) for w, _ in each), max(int(h) for _, h in each))]
        if len(set(each)) > 1:
            raise ValueError(f"graphs of different {name} in one batch: {sorted(set(each))}")
        settings[name] = each[0]
    # as `torch_geometric.transforms.Cartesian` computes them
    settings.setdefault("pseudo", "signed-time" if len(settings.get("reach", "xy")) == 3 else "signed")
    check_pseudo(settings["pseudo"])
    return settings


def _nodes(found: dict[str, Any]) -> dict[str, torch.Tensor]:
    x, pos = found["x"], found["pos"]
    if x.ndim != 2 or pos.shape != (x.shape[0], 2):
        shapes = f"{list(x.shape)} and {list(pos.shape)}"
        raise ValueError(f"x and pos must be [N, F] and [N, 2] (pixels; times belong in t), not {shapes}")
    t = found.get("t", torch.zeros(x.shape[0], dtype=torch.int64, device=x.device))
    if t.shape != x.shape[:1] or t.is_floating_point():
        raise ValueError(f"t must be whole µs, [{x.shape[0]}], not {t.dtype} {list(t.shape)}")
    return {"x": x if x.is_floating_point() else x.float(), "pos": pos.float(), "t": t.long()}


def _edges(found: dict[str, Any]) -> dict[str, torch.Tensor]:
    """Return the fields `edge_index`, grouped by target, and `edge_attr`, if there is one."""
    edges, nodes = found["edge_index"], found["x"].shape[0]
    if edges.ndim != 2 or edges.shape[0] != 2 or edges.is_floating_point():
        raise ValueError(f"edge_index must be int64 [2, E], not {edges.dtype} {list(edges.shape)}")
    edges = edges.long().contiguous()
    if edges.numel() and not 0 <= int(edges.min()) <= int(edges.max()) < nodes:
        raise ValueError(f"edge_index names nodes from {edges.min()} to {edges.max()}; there are {nodes}")
    u = found.get("edge_attr")
    wanted = [edges.shape[1], len(found.get("reach", "xy"))]
    if u is not None and list(u.shape) != wanted:
        without = "remove edge_attr to have them computed from pos"
        raise ValueError(f"edge_attr must be pseudo-coordinates {wanted}, not {list(u.shape)}; {without}")
    target = edges[1]
    if (target[1:] < target[:-1]).any():
        order = torch.argsort(target, stable=True)
        edges, u = edges[:, order], None if u is None else u[order]
    return {"edge_index": edges} if u is None else {"edge_index": edges, "edge_attr": u.float()}


def _membership(data: Any, found: dict[str, Any]) -> dict[str, Any]:
    """Return `batch` and `ptr`, and `y` as a tensor; a `Data` without `batch` is a batch of one."""
    x, edges = found["x"], found["edge_index"]
    if "batch" not in found:
        batch = torch.zeros(x.shape[0], dtype=torch.int64, device=x.device)
        y = found.get("y")
        labels = {} if y is None or isinstance(y, torch.Tensor) else {"y": torch.as_tensor([y], device=x.device)}
        return {"batch": batch, "ptr": torch.tensor([0, x.shape[0]], device=x.device), **labels}
    batch = found["batch"].long()
    if batch.shape != x.shape[:1] or (batch[1:] < batch[:-1]).any() or (batch[:1] < 0).any():
        raise ValueError(f"batch must be the numbers of the nodes' graphs in ascending order, [{x.shape[0]}]")
    if (batch[edges[0]] != batch[edges[1]]).any():
        raise ValueError("edge_index has edges from one graph to another")
    highest = int(batch[-1]) + 1 if batch.numel() else 0
    sizes = torch.bincount(batch, minlength=max(highest, int(getattr(data, "num_graphs", 0) or 0)))
    return {"batch": batch, "ptr": torch.cat((sizes.new_zeros(1), sizes.cumsum(0)))}
