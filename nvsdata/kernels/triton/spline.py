"""B-spline convolution by offset classes: edges with equal pseudo-coordinates share one matrix of weights.

Events are on a grid of pixels, so the edges of a graph have few different pseudo-coordinates (29 within 3 pixels). The
edges of each class need one product of their sources' features with the matrix of the class. Sums use atomic additions,
so their last digits can differ between runs.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
import triton
import triton.language as tl

MOST = 512  # largest number of classes; each has a matrix
EDGES, CHUNK = 64, 2048  # edges of a product; of a program that sums gradients of a matrix
SIDE = 32  # input and output channels of a product, at least 16


class Classes(NamedTuple):
    """The edges of a graph, sorted by class."""

    source: torch.Tensor  # int64 [E]
    target: torch.Tensor  # int64 [E]
    degree: torch.Tensor  # number of edges of each edge's target, int64 [E]
    start: torch.Tensor  # first edge of each class, and E: int64 [K + 1]
    u: torch.Tensor  # pseudo-coordinates of each class, float32 [K, 2]


def offset_classes(edge_index: torch.Tensor, u: torch.Tensor, nodes: int) -> Classes | None:
    """Sort edges by their pseudo-coordinates; None if there are more than `MOST` classes. O(E log E).

    Args:
        edge_index: Sources and targets, int64 [2, E], of at least one edge.
        u: Pseudo-coordinates, float32 [E, 2].
        nodes: Number of nodes.

    Raises:
        ValueError: An edge has a node that doesn't exist.
    """
    # the bits of both numbers; the sum turns -0 into 0
    keys, order = torch.sort((u + 0.0).contiguous().view(torch.int64).squeeze(1), stable=True)
    changes = (keys[1:] != keys[:-1]).nonzero().squeeze(1) + 1
    if changes.numel() >= MOST:
        return None
    # the host has waited for the device already
    least, most = torch.stack(torch.aminmax(edge_index)).tolist()
    if least < 0 or most >= nodes:
        raise ValueError(f"edge_index names nodes from {least} to {most}; there are {nodes}")
    source, target = edge_index[:, order]
    degree = target.new_zeros(nodes).scatter_add_(0, target, torch.ones_like(target))
    start = torch.nn.functional.pad(changes, (1, 0))
    ends = torch.nn.functional.pad(start, (0, 1), value=keys.numel())
    return Classes(source.contiguous(), target.contiguous(), degree[target], ends, u[order[start]])


def add_products(
    onto: torch.Tensor,
    into: torch.Tensor,
    x: torch.Tensor,
    of: torch.Tensor,
    table: torch.Tensor,
    classes: Classes,
) -> None:
    """Add x[of[e]] @ table[class of e] / degree[e] to onto[into[e]] for every edge e. O(E · C_in · C_out).

    Args:
        onto: The sums, contiguous [N, C_out].
        into: Row of `onto` of each edge, int64 [E].
        x: Features, contiguous [M, C_in].
        of: Row of `x` of each edge, int64 [E].
        table: Matrix of each class [K, C_in, C_out], with any strides.
        classes: The edges.
    """
    kind, begin = _tiles(classes.start, into.numel(), EDGES)
    sizes = x.shape[1], onto.shape[1]
    numbers = *sizes, *table.stride(), EDGES, SIDE
    edges = classes.degree, classes.start, kind, begin
    with torch.cuda.device_of(x):
        _products[kind.numel(), triton.cdiv(sizes[1], SIDE)](
            onto, into, x, of, table, *edges, *numbers, enable_fp_fusion=True
        )


def table_gradient(gradient: torch.Tensor, x: torch.Tensor, classes: Classes) -> torch.Tensor:
    """Return the gradient of `add_products` (from sources to targets) with respect to `table`, [K, C_in, C_out].

    `gradient` [N, C_out] is that of the sums, `x` [N, C_in] contains the features; both are contiguous.
    """
    kind, begin = _tiles(classes.start, classes.source.numel(), CHUNK)
    sizes = x.shape[1], gradient.shape[1]
    out = x.new_zeros(len(classes.u), *sizes)
    grid = kind.numel(), *(triton.cdiv(size, SIDE) for size in sizes)
    edges = classes.source, classes.target, classes.degree, classes.start, kind, begin
    with torch.cuda.device_of(x):
        _outer_products[grid](out, x, gradient, *edges, *sizes, EDGES, CHUNK, SIDE, enable_fp_fusion=True)
    return out


def _tiles(start: torch.Tensor, edges: int, size: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the class and first edge of tiles of up to `size` edges of one class. Tiles that aren't needed are empty.

    Their number is a bound, so that the host needn't wait for the device.
    """
    classes = start.numel() - 1
    needed = (start.diff() + size - 1) // size
    ends = needed.cumsum(0)
    tile = torch.arange(edges // size + classes, device=start.device)
    kind = torch.searchsorted(ends, tile, right=True).clamp(max=classes - 1)
    # beyond the last tile, this is beyond the last edge of the class
    return kind, start[kind] + (tile - (ends - needed)[kind]) * size


@triton.jit
def _products(
    onto,
    into,
    x,
    of,
    table,
    degree,
    start,
    kinds,
    begins,
    inputs,
    outputs,
    by_class,
    by_input,
    by_output,
    EDGES: tl.constexpr,
    SIDE: tl.constexpr,
):
    kind = tl.load(kinds + tl.program_id(0))
    begin = tl.load(begins + tl.program_id(0))
    stop = tl.load(start + kind + 1)
    if begin < stop:
        edge = begin + tl.arange(0, EDGES)
        here = edge < stop
        row = tl.load(of + edge, mask=here, other=0)
        column = tl.program_id(1) * SIDE + tl.arange(0, SIDE)
        sums = tl.zeros((EDGES, SIDE), dtype=x.dtype.element_ty)
        for first in range(0, inputs, SIDE):
            channel = first + tl.arange(0, SIDE)
            inside = here[:, None] & (channel < inputs)[None, :]
            features = tl.load(x + row[:, None] * inputs + channel[None, :], mask=inside, other=0.0)
            place = table + kind * by_class + channel[:, None] * by_input + column[None, :] * by_output
            inside = (channel < inputs)[:, None] & (column < outputs)[None, :]
            weights = tl.load(place, mask=inside, other=0.0)
            # without tf32, as in torch by default
            sums = tl.dot(features, weights, sums, input_precision="ieee", out_dtype=x.dtype.element_ty)
        number = tl.load(degree + edge, mask=here, other=1).to(x.dtype.element_ty)
        node = tl.load(into + edge, mask=here, other=0)
        inside = here[:, None] & (column < outputs)[None, :]
        tl.atomic_add(onto + node[:, None] * outputs + column[None, :], sums / number[:, None], inside, sem="relaxed")


@triton.jit
def _outer_products(
    out,
    x,
    gradient,
    source,
    target,
    degree,
    start,
    kinds,
    begins,
    inputs,
    outputs,
    EDGES: tl.constexpr,
    CHUNK: tl.constexpr,
    SIDE: tl.constexpr,
):
    kind = tl.load(kinds + tl.program_id(0))
    begin = tl.load(begins + tl.program_id(0))
    stop = tl.minimum(tl.load(start + kind + 1), begin + CHUNK)
    if begin < stop:
        channel = tl.program_id(1) * SIDE + tl.arange(0, SIDE)
        column = tl.program_id(2) * SIDE + tl.arange(0, SIDE)
        sums = tl.zeros((SIDE, SIDE), dtype=x.dtype.element_ty)
        for first in range(begin, stop, EDGES):
            edge = first + tl.arange(0, EDGES)
            here = edge < stop
            row = tl.load(source + edge, mask=here, other=0)
            inside = (channel < inputs)[:, None] & here[None, :]
            features = tl.load(x + row[None, :] * inputs + channel[:, None], mask=inside, other=0.0)
            row = tl.load(target + edge, mask=here, other=0)
            number = tl.load(degree + edge, mask=here, other=1).to(x.dtype.element_ty)
            inside = here[:, None] & (column < outputs)[None, :]
            given = tl.load(gradient + row[:, None] * outputs + column[None, :], mask=inside, other=0.0)
            given = given / number[:, None]
            sums = tl.dot(features, given, sums, input_precision="ieee", out_dtype=x.dtype.element_ty)
        inside = (channel < inputs)[:, None] & (column < outputs)[None, :]
        place = out + (kind * inputs + channel[:, None]) * outputs + column[None, :]
        tl.atomic_add(place, sums, inside, sem="relaxed")
