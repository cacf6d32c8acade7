"""Pseudo-coordinates of edges: the position of the source relative to the target, in [0, 1]."""

from __future__ import annotations

from typing import Literal, get_args

import torch

from nvsdata.kernels.graph import edges as kernel

Pseudo = Literal["abs", "signed", "signed-time"]
Reach = tuple[float, ...]
"""Normalization range of each axis: pixels along x and y, and µs for "signed-time"."""


def check_pseudo(kind: str) -> None:
    """Raise ValueError for an unknown kind of pseudo-coordinates."""
    if kind not in get_args(Pseudo):
        raise ValueError(f"pseudo must be one of {get_args(Pseudo)}, not {kind!r}")


def axes(kind: Pseudo) -> int:
    """Return the number of pseudo-coordinates of an edge."""
    return 3 if kind == "signed-time" else 2


def origin(kind: Pseudo) -> float:
    """Return the pseudo-coordinate of an edge from a node to itself, which is the same along each axis."""
    return 0.0 if kind == "abs" else 0.5


def pseudo(
    pos: torch.Tensor, t: torch.Tensor, edge_index: torch.Tensor, reach: Reach, kind: Pseudo = "abs"
) -> torch.Tensor:
    """Return the pseudo-coordinates of edges (thesis, section 4.2.1).

    Args:
        pos: Positions of nodes in pixels, float32 [N, 2].
        t: Times of nodes in µs, int64 [N].
        edge_index: Source and target of each edge, int64 [2, E].
        reach: Normalization range: pixels along x and y, and µs if there is a third axis. Larger differences are
            clipped.
        kind: "abs" (default): |dx| / reach, as in the thesis. "signed": 1/2 + dx / (2 reach) with dx from target to
            source, as in the code of its author. "signed-time": the same, with dt as a third axis.

    Returns:
        float32 [E, 2], or [E, 3] with time, in [0, 1].

    Raises:
        ValueError: If the kind is unknown, or `reach` has another number of axes.
    """
    check_pseudo(kind)
    if len(reach) != axes(kind):
        raise ValueError(f"reach has {len(reach)} numbers, which doesn't fit pseudo {kind!r}")
    # the kernel needs values, which tensors don't have under torch.compile and torch.export
    if pos.device.type == "cpu" and not torch.compiler.is_compiling():
        ends = tuple(map(float, reach))
        made = kernel.pseudo_coordinates(pos.numpy(), t.numpy(), edge_index.numpy(), ends, kind != "abs")
        return torch.from_numpy(made)
    source, target = edge_index
    offset = pos[source] - pos[target]
    if kind == "signed-time":
        offset = torch.cat((offset, (t[source] - t[target]).unsqueeze(1).to(offset.dtype)), 1)
    relative = offset / offset.new_tensor(reach)
    return relative.abs().clamp(max=1) if kind == "abs" else (relative / 2 + 0.5).clamp(0, 1)
