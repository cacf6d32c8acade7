"""Pseudo-coordinates of edges: where the source lies, as seen from the target."""

from __future__ import annotations

from typing import Literal, get_args

import torch

from nvsdata.kernels.graph import edges as kernel

Pseudo = Literal["abs", "signed", "signed-time"]
Reach = tuple[float, ...]
"""Pixels along x and y, and for "signed-time" µs, that the end of an axis stands for."""


def check_pseudo(kind: str) -> None:
    """ValueError for an unknown kind of pseudo-coordinates."""
    if kind not in get_args(Pseudo):
        raise ValueError(f"pseudo must be one of {get_args(Pseudo)}, not {kind!r}")


def axes(kind: Pseudo) -> int:
    """Number of pseudo-coordinates of an edge."""
    return 3 if kind == "signed-time" else 2


def origin(kind: Pseudo) -> float:
    """The pseudo-coordinate, along each axis, of an edge from a node to itself."""
    return 0.0 if kind == "abs" else 0.5


def pseudo(
    pos: torch.Tensor, t: torch.Tensor, edge_index: torch.Tensor, reach: Reach, kind: Pseudo = "abs"
) -> torch.Tensor:
    """Pseudo-coordinates float32 [E, 2], or [E, 3] with time, in [0, 1] (thesis 4.2.1).

    - `pos` float32 [N, 2], `t` int64 [N] (µs), `edge_index` int64 [2, E]: the graph's
    - `reach`: differences that count as 1, as do larger ones: pixels along x and y, and µs if there is a third axis
    - `kind`: "abs" (default), the text's |dx| / reach; "signed", the author's code's 1/2 + dx / (2 reach), with dx
      from target to source; "signed-time", the same with dt as a third axis
    """
    check_pseudo(kind)
    if len(reach) != axes(kind):
        raise ValueError(f"reach has {len(reach)} numbers, which doesn't fit pseudo {kind!r}")
    # kernels look at values, which torch.compile and torch.export have none of
    if pos.device.type == "cpu" and not torch.compiler.is_compiling():
        ends = tuple(map(float, reach))
        made = kernel.pseudo_coordinates(pos.numpy(), t.numpy(), edge_index.numpy(), ends, kind != "abs")
        return torch.from_numpy(made)
    source, target = edge_index
    offset = pos[source] - pos[target]
    if kind == "signed-time":
        offset = torch.cat((offset, (t[source] - t[target]).unsqueeze(1).to(offset.dtype)), 1)
    share = offset / offset.new_tensor(reach)
    return share.abs().clamp(max=1) if kind == "abs" else (share / 2 + 0.5).clamp(0, 1)
