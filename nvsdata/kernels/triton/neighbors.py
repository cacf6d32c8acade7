"""The nearest events of each event in space and time, on the pixel grids of several graphs.

The edges are those of `kernels.graph.neighbors.near_edges`, in the same order. Distances are computed in float64
without fused multiply-adds, like those of the CPU, because at exactly the radius the last bit decides.
"""

from __future__ import annotations

import math

import torch
import triton
import triton.language as tl

LANES = 512  # heads of lists of events that a program compares
FAR = 2**31 - 1  # larger than the index of any event


def offsets_within(radius: float, alpha: float) -> list[tuple[int, int]] | None:
    """Return the offsets (dx, dy) of pixels within the radius; None if there are too many for a program."""
    limit = radius * radius
    if not limit / alpha < LANES:
        return None
    side = math.isqrt(int(limit / alpha)) + 1
    span = range(-side, side + 1)
    found = [(dx, dy) for dy in span for dx in span if alpha * float(dx * dx + dy * dy) <= limit]
    return found if 2 * len(found) <= LANES else None


def near_edges(
    t: torch.Tensor,
    x: torch.Tensor,
    y: torch.Tensor,
    graph: torch.Tensor,
    grid: tuple[int, int, int],
    offsets: list[tuple[int, int]],
    metric: tuple[float, float, float],
    k: int,
) -> torch.Tensor:
    """Return the edges to each event from its `k` nearest: int64 [2, E], sorted by (target, source).

    The lists of events of the pixels within the radius are merged, nearest first, in O(N k P) for P pixels. Memory:
    N k indices, and a table of all pixels.

    Args:
        t: Times in µs, int64 [N], which don't decrease within a graph.
        x: Columns, int64 [N].
        y: Rows, int64 [N].
        graph: Graph of each event, int64 [N], which doesn't decrease.
        grid: Number of graphs, rows and columns.
        offsets: Pixels to search; see `offsets_within`.
        metric: Radius, alpha and beta; see `RadiusGraph`.
        k: Largest number of edges that end in an event, at least 1.
    """
    events, (graphs, height, width) = t.numel(), grid
    pixel = (graph * height + y) * width + x
    order = torch.argsort(pixel, stable=True)
    counts = torch.zeros(graphs * height * width, dtype=torch.int32, device=t.device)
    counts.scatter_add_(0, pixel, torch.ones_like(pixel, dtype=torch.int32))
    first = torch.nn.functional.pad(counts.cumsum(0, dtype=torch.int32), (1, 0))
    times = t[order]
    run_first, run_stop = _runs(pixel[order], times)
    radius, alpha, beta = metric
    # a tensor, because Triton takes Python's numbers as float32
    limits = torch.tensor((radius * radius, alpha, beta), dtype=torch.float64, device=t.device)
    steps = torch.tensor(offsets, dtype=torch.int32, device=t.device)
    lanes = int(triton.next_power_of_2(2 * len(offsets)))
    block = max(LANES // lanes, 1)
    source = torch.full((events, k), FAR, dtype=torch.int32, device=t.device)
    lists = order.int(), times, first, run_first, run_stop
    numbers = events, width, height, len(offsets), events.bit_length(), k
    with torch.cuda.device_of(t):
        _nearest[(triton.cdiv(events, block),)](
            source, *lists, x, y, graph, t, steps, limits, *numbers, block, lanes, FAR, enable_fp_fusion=False
        )
    source = source.sort(1).values
    target, place = (source < FAR).nonzero(as_tuple=True)
    return torch.stack((source[target, place].long(), target))


def _runs(pixel: torch.Tensor, times: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the beginning and end of each event's run of equal pixels and times, int32 [N]."""
    index = torch.arange(pixel.numel(), dtype=torch.int32, device=pixel.device)
    begins = torch.ones_like(pixel, dtype=torch.bool)
    begins[1:] = (pixel[1:] != pixel[:-1]) | (times[1:] != times[:-1])
    run = begins.cumsum(0) - 1
    starts = torch.nn.functional.pad(index[begins], (0, 1), value=pixel.numel())
    return starts[run], starts[run + 1]


@triton.jit
def _nearest(
    source,
    order,
    times,
    first,
    run_first,
    run_stop,
    xs,
    ys,
    graphs,
    ts,
    steps,
    limits,
    events,
    width,
    height,
    offsets,
    halvings,
    k,
    EVENTS: tl.constexpr,
    LANES: tl.constexpr,
    FAR: tl.constexpr,
):
    event = tl.program_id(0) * EVENTS + tl.arange(0, EVENTS)
    here = event < events
    limit = tl.load(limits)
    alpha = tl.load(limits + 1)
    beta = tl.load(limits + 2)
    now = tl.load(ts + event, mask=here, other=0)[:, None]
    # each pixel has two lanes: one for later events, one for earlier events, both from the event outward in time
    lane = tl.arange(0, LANES)
    back = (lane % 2 == 1)[None, :]
    offset = lane // 2
    exists = offset < offsets
    dx = tl.load(steps + 2 * offset, mask=exists, other=0)
    dy = tl.load(steps + 2 * offset + 1, mask=exists, other=0)
    space = (alpha * (dx * dx + dy * dy).to(tl.float64))[None, :]
    column = tl.load(xs + event, mask=here, other=0)[:, None] + dx[None, :]
    row = tl.load(ys + event, mask=here, other=0)[:, None] + dy[None, :]
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height) & here[:, None] & exists[None, :]
    cell = (tl.load(graphs + event, mask=here, other=0)[:, None] * height + row) * width + column
    begin = tl.load(first + cell, mask=inside, other=0)
    stop = tl.load(first + cell + 1, mask=inside, other=0)
    # the pixel's first event that is not before this one
    later = begin
    high = stop
    for _ in range(halvings):
        unsure = later < high
        middle = (later + high) // 2
        before = tl.load(order + middle, mask=unsure, other=0) < event[:, None]
        later = tl.where(unsure & before, middle + 1, later)
        high = tl.where(unsure & (before == 0), middle, high)
    itself = tl.load(order + later, mask=later < stop, other=FAR) == event[:, None]
    ahead = later + itself.to(tl.int32)
    # of earlier events at one time, the smallest index comes first
    behind = tl.load(run_first + later - 1, mask=later > begin, other=0)
    place = tl.where(back, behind, ahead)
    there = tl.where(back, later > begin, ahead < stop) & inside
    # the head of each lane
    index = tl.load(order + place, mask=there, other=FAR)
    dt = tl.abs(tl.load(times + place, mask=there, other=0) - now)
    d = space + beta * (dt.to(tl.float64) * dt.to(tl.float64))
    there = there & (d <= limit)
    step = 0
    while (step < k) & (tl.max(there.to(tl.int32)) > 0):
        distance = tl.where(there, d, float("inf"))
        nearest = there & (distance == tl.min(distance, axis=1)[:, None])
        gap = tl.where(nearest, dt, 1 << 62)
        nearest = nearest & (gap == tl.min(gap, axis=1)[:, None])
        chosen = tl.min(tl.where(nearest, index, FAR), axis=1)
        tl.store(source + event.to(tl.int64) * k + step, chosen, mask=here)
        taken = nearest & (index == chosen[:, None])
        # move the lane of the chosen event on: within a run, or to the run before
        begun = tl.load(run_first + place, mask=taken & back, other=0)
        ended = tl.minimum(tl.load(run_stop + place, mask=taken & back, other=0), later)
        over = back & (place + 1 >= ended)
        behind = tl.load(run_first + begun - 1, mask=taken & over & (begun > begin), other=0)
        more = tl.where(over, begun > begin, back | (place + 1 < stop))
        place = tl.where(taken, tl.where(over, behind, place + 1), place)
        there = there & ((taken == 0) | more)
        moved = taken & there
        index = tl.where(moved, tl.load(order + place, mask=moved, other=FAR), index)
        apart = tl.abs(tl.load(times + place, mask=moved, other=0) - now)
        dt = tl.where(moved, apart, dt)
        d = tl.where(moved, space + beta * (dt.to(tl.float64) * dt.to(tl.float64)), d)
        there = there & (d <= limit)
        step += 1
