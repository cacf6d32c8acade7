"""Graphs that the author of the thesis released as MATLAB files."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import scipy.io
import torch

from nvsdata.common.errors import FormatError
from nvsdata.data.graph import Graph, grouped
from nvsdata.data.pseudo import Pseudo
from nvsdata.data.pseudo import pseudo as pseudo_coordinates

# sensor size and normalization range of the radius graphs of CIFAR10-DVS, and of the nearest-neighbor graphs of
# UCF101-DVS (`T.KNNGraph`)
RADIUS, NEAREST = ((128, 128), (3.0, 3.0)), ((240, 180), (8.0, 8.0))


def read_author_graphs(path: str | os.PathLike[str], pseudo: Pseudo = "signed") -> list[Graph]:
    """Read the graph of a CIFAR10-DVS file, or the S graphs of a UCF101-DVS file.

    The first row of `edge` is the target, the second the source. The files contain no times: `t` of the graphs is 0.

    Args:
        path: The file. A file of CIFAR10-DVS has `feature` [N, 1], `pseudo` [N, 2] (pixels), `edge` [2, E] and
            `label`, which becomes `y`. A file of UCF101-DVS has a struct `graph` [1, S] of `feature` [N, 2], `pos`
            [N, 2] (pixels, counted from 1) and `edge` [2, N].
        pseudo: Kind of pseudo-coordinates (default "signed", as in the author's code). "signed-time" isn't possible.

    Returns:
        One graph, or S graphs.

    Raises:
        FormatError: If the file is of neither dataset.
    """
    with open(path, "rb") as file:
        try:
            found = scipy.io.loadmat(file)
        except Exception as error:  # on a damaged file scipy may raise anything
            raise FormatError(path, f"can't be read as MATLAB v5: {error!r}") from None
    if {"feature", "pseudo", "edge"} <= found.keys():
        label = int(found["label"].ravel()[0]) if "label" in found else None
        return [_graph(path, found["feature"], found["pseudo"], found["edge"], *RADIUS, pseudo, label)]
    if "graph" in found and {"feature", "pos", "edge"} <= set(found["graph"].dtype.names or ()):
        each = found["graph"].ravel()
        return [_graph(path, g["feature"], g["pos"].astype(np.float32) - 1, g["edge"], *NEAREST, pseudo) for g in each]
    names = [name for name in found if not name.startswith("__")]
    raise FormatError(path, f"contains neither feature, pseudo and edge nor a struct `graph` with them, but {names}")


def _graph(
    path: Any,
    feature: Any,
    pos: Any,
    edge: Any,
    sensor_size: tuple[int, int],
    reach: tuple[float, float],
    kind: Pseudo,
    y: Any = None,
) -> Graph:
    if feature.ndim != 2 or pos.shape != (len(feature), 2) or edge.ndim != 2 or len(edge) != 2:
        shapes = f"feature {feature.shape}, positions {pos.shape} and edges {edge.shape}"
        raise FormatError(path, f"has {shapes}, not [N, F], [N, 2] and [2, E]")
    positions = torch.from_numpy(pos.astype(np.float32))
    given = torch.from_numpy(edge[::-1].astype(np.int64))
    try:
        source, target, _ = grouped(given, torch.zeros_like(given.T, dtype=torch.float32), len(pos))
    except ValueError as error:
        raise FormatError(path, str(error)) from None
    edges = torch.stack((source, target))
    x = torch.from_numpy(feature.astype(np.float32))
    t = torch.zeros(len(x), dtype=torch.int64)
    u = pseudo_coordinates(positions, t, edges, reach, kind)
    return Graph(x, positions, t, edges, u, y, sensor_size, reach, kind)
