"""Radius graphs of several recordings, built on a GPU by Triton."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np
import torch

from nvsdata.data.events import Events
from nvsdata.data.graph import GraphBatch
from nvsdata.data.pseudo import Pseudo, Reach, pseudo
from nvsdata.kernels.triton import works

MOST_PIXELS = 2**26  # of all graphs of a batch: there is a table of them
X_BITS, Y_BITS, TIME_BITS = 12, 11, 32  # of an event, in addition to one bit for the polarity: 7 bytes


def graphs_on_gpu(
    samples: Sequence[Events],
    device: torch.device,
    limits: tuple[float, float, float, int],
    reach: Reach,
    kind: Pseudo,
) -> GraphBatch | None:
    """Return the graphs of a batch, or None if Triton can't build them: there is no GPU, or a number is too large.

    Args:
        samples: Events of each graph.
        device: The device.
        limits: Radius, alpha, beta and largest degree.
        reach: Normalization ranges of the pseudo-coordinates.
        kind: Kind of pseudo-coordinates.
    """
    radius, alpha, beta, degree = limits
    if alpha == 0 or not works(device) or (packed := pack(samples)) is None:
        return None
    from nvsdata.kernels.triton.neighbors import near_edges, offsets_within

    counts = [len(events) for events in samples]
    width, height = (max(int(getattr(e, axis).max(initial=0)) for e in samples) + 1 for axis in "xy")
    offsets = offsets_within(radius, alpha)
    if offsets is None or len(counts) * width * height > MOST_PIXELS:
        return None
    t, x, y, p = unpack(torch.from_numpy(packed).to(device))
    ptr = torch.tensor([0, *accumulate(counts)], device=device)
    graph = torch.repeat_interleave(torch.arange(len(counts), device=device), ptr.diff(), output_size=len(t))
    k = max(min(degree, max(counts) - 1), 1)
    edges = near_edges(t, x, y, graph, (len(counts), height, width), offsets, (radius, alpha, beta), k)
    pos = torch.stack((x, y), 1).float()
    sizes = [events.sensor_size for events in samples if events.sensor_size is not None]
    return GraphBatch(
        x=(2 * p - 1).float().unsqueeze(1),
        pos=pos,
        t=t,
        edge_index=edges,
        edge_attr=pseudo(pos, t, edges, reach, kind),
        sensor_size=(max(w for w, _ in sizes), max(h for _, h in sizes)) if sizes else None,
        reach=reach,
        pseudo=kind,
        batch=graph,
        ptr=ptr,
    )


def pack(samples: Sequence[Events]) -> np.ndarray | None:
    """Return all events as 7 bytes each, uint8 [7 N]; None if there are no events, or if a number needs more bits.

    The times since the start of each recording come first, uint32 [N]. Then come the low, middle and high bytes of
    x + 2^12 y + 2^23 p.
    """
    if not any(map(len, samples)):
        return None
    t = np.concatenate([events.t - events.start for events in samples])
    x, y, p = (np.concatenate([getattr(events, name) for events in samples]).astype(np.int64) for name in "xyp")
    for values, bits in ((t, TIME_BITS), (x, X_BITS), (y, Y_BITS)):
        if values.min() < 0 or values.max() >> bits:
            return None
    place = x | y << X_BITS | p << (X_BITS + Y_BITS)
    parts = [t.astype(np.uint32).view(np.uint8), *((place >> shift & 255).astype(np.uint8) for shift in (0, 8, 16))]
    return np.concatenate(parts)


def unpack(packed: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return times, columns, rows and polarities of packed events, int64 [N] each."""
    count = packed.numel() // 7
    t = packed[: 4 * count].view(torch.int32).long() & (1 << TIME_BITS) - 1
    low, middle, high = packed[4 * count :].view(3, count).long()
    place = low | middle << 8 | high << 16
    x, y = place & (1 << X_BITS) - 1, place >> X_BITS & (1 << Y_BITS) - 1
    return t, x, y, place >> X_BITS + Y_BITS
