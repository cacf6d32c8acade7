"""Features pooled over clusters, by segments of nodes sorted by cluster. Results don't differ between runs.

The results are those of `kernels.graph.pool`, bit by bit. Every cluster must have a node.
"""

from __future__ import annotations

import torch
import triton
import triton.language as tl

CHANNELS = 128  # largest number of channels of a program


def segments(cluster: torch.Tensor, count: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Return nodes sorted by cluster, int64 [N], and the first of each of `count` clusters, int64 [count + 1].

    The nodes of a cluster keep their order. O(N log N).
    """
    members = cluster.new_zeros(count).scatter_add_(0, cluster, torch.ones_like(cluster))
    return torch.argsort(cluster, stable=True), torch.nn.functional.pad(members.cumsum(0), (1, 0))


def max_rows(x: torch.Tensor, order: torch.Tensor, start: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the maximum of each channel over each cluster, and the first node that has it. O(N · C).

    NaN counts as larger than any number.

    Args:
        x: Features, contiguous [N, C].
        order: Nodes sorted by cluster; see `segments`.
        start: First node of each cluster.

    Returns:
        Maxima [M, C], and nodes int64 [M, C].
    """
    count, channels = start.numel() - 1, x.shape[1]
    best, where = x.new_empty(count, channels), order.new_empty(count, channels)
    wide = _width(channels)
    if x.numel():
        with torch.cuda.device_of(x):
            _max[count, triton.cdiv(channels, wide)](
                x, order, start, best, where, channels, wide, enable_fp_fusion=False
            )
    return best, where


def mean_rows(x: torch.Tensor, order: torch.Tensor, start: torch.Tensor) -> torch.Tensor:
    """Return the mean of each channel over each cluster, [M, C], summed in float64. O(N · C). See `max_rows`."""
    count, channels = start.numel() - 1, x.shape[1]
    mean, wide = x.new_empty(count, channels), _width(channels)
    if x.numel():
        with torch.cuda.device_of(x):
            _mean[count, triton.cdiv(channels, wide)](x, order, start, mean, channels, wide, enable_fp_fusion=False)
    return mean


def _width(channels: int) -> int:
    """Return the number of channels of a program, a power of 2."""
    return min(int(triton.next_power_of_2(channels)), CHANNELS)


@triton.jit
def _max(x, order, start, best, where, channels, WIDE: tl.constexpr):
    cluster = tl.program_id(0).to(tl.int64)
    channel = tl.program_id(1) * WIDE + tl.arange(0, WIDE)
    inside = channel < channels
    begin = tl.load(start + cluster)
    stop = tl.load(start + cluster + 1)
    node = tl.load(order + begin)
    most = tl.load(x + node * channels + channel, mask=inside, other=0.0)
    from_node = tl.zeros((WIDE,), tl.int64) + node
    for n in range(begin + 1, stop):
        node = tl.load(order + n)
        value = tl.load(x + node * channels + channel, mask=inside, other=0.0)
        # true for the first NaN
        more = ((value > most) | (value != value)) & (most == most)
        most = tl.where(more, value, most)
        from_node = tl.where(more, node, from_node)
    tl.store(best + cluster * channels + channel, most, mask=inside)
    tl.store(where + cluster * channels + channel, from_node, mask=inside)


@triton.jit
def _mean(x, order, start, mean, channels, WIDE: tl.constexpr):
    cluster = tl.program_id(0).to(tl.int64)
    channel = tl.program_id(1) * WIDE + tl.arange(0, WIDE)
    inside = channel < channels
    begin = tl.load(start + cluster)
    stop = tl.load(start + cluster + 1)
    sums = tl.zeros((WIDE,), tl.float64)
    for n in range(begin, stop):
        node = tl.load(order + n)
        sums += tl.load(x + node * channels + channel, mask=inside, other=0.0).to(tl.float64)
    sums = sums / (stop - begin).to(tl.float64)
    tl.store(mean + cluster * channels + channel, sums.to(mean.dtype.element_ty), mask=inside)
