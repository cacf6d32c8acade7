"""Learned event tensors (EST)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

from nvsdata.common.validation import whole
from nvsdata.data.ragged import EventBatch
from nvsdata.kernels.represent.inside import inside
from nvsdata.kernels.represent.learned import splat, splat_gradient

SLOPE = 0.1  # slope of the leaky ReLU below 0
NARROW = 1e-7  # width below which a piece of the kernel is merged with its neighbor
LOOKUP = 4096


class EST(nn.Module):
    """Event spike tensor: each event adds t* f(t* - c / (C - 1)) to channel c of its pixel (Gehrig et al. 2019, eq. 9).

    t* is 0 at a sample's first event and 1 at its last. The kernel f is a small network with one input and leaky ReLUs
    between its layers. It is initialized as exactly the trilinear kernel, max(0, 1 - (C - 1) |u|). Because f is
    piecewise linear, it is evaluated at two positions of each piece only. The result and the gradients are the same as
    with an evaluation for every event. There is no gradient with respect to times.

    The network takes an `EventBatch` (`nvsdata.collate(samples, events="columns")`) of B samples of one sensor size. It
    returns float32 [B, 2 C, H, W], OFF before ON.

    Args:
        bins: C, number of channels per polarity (default 9).
        hidden: Units of the hidden layers, each at least 6 (default (30, 30), as in the authors' experiments).

    Raises:
        ValueError: For settings out of range, samples of several sensor sizes, and events outside their sensor.

    Example:
        >>> import nvsdata
        >>> from nvsdata import models
        >>> samples = [(nvsdata.Events([0, 9], [1, 2], [0, 1], [1, 0], (4, 3)), 0)]
        >>> batch, _ = nvsdata.collate(samples, events="columns")
        >>> models.EST(bins=5)(batch).shape
        torch.Size([1, 10, 3, 4])
    """

    def __init__(self, bins: int = 9, hidden: Sequence[int] = (30, 30)) -> None:
        super().__init__()
        whole("bins", bins, 1)
        for units in hidden:
            whole("hidden", units, 6)
        self.bins = int(bins)
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise((1, *hidden, 1)))
        self.reset_parameters()

    def extra_repr(self) -> str:
        """Return the settings for repr()."""
        return f"bins={self.bins}"

    @torch.no_grad()
    def reset_parameters(self) -> None:
        """Sample the weights at random, except for six units of each layer, which form the trilinear kernel."""
        width = 1 / max(self.bins - 1, 1)
        first, *inner, last = (layer for layer in self.layers if isinstance(layer, nn.Linear))
        for layer in (first, *inner, last):
            layer.reset_parameters()
        # max(u, 0) is (leaky(u) + SLOPE leaky(-u)) / (1 - SLOPE²)
        first.weight[:6, 0] = torch.tensor([1.0, -1.0] * 3)
        first.bias[:6] = torch.tensor([width, -width, 0.0, 0.0, -width, width])
        triangle = torch.tensor([1.0, SLOPE, -2.0, -2 * SLOPE, 1.0, SLOPE]) / (width * (1 - SLOPE**2))
        for layer in inner:
            layer.weight[:2], layer.bias[:2] = 0, 0
            layer.weight[0, : triangle.numel()], layer.weight[1, : triangle.numel()] = triangle, -triangle
            # u is (leaky(u) - leaky(-u)) / (1 + SLOPE)
            triangle = torch.tensor([1.0, -1.0]) / (1 + SLOPE)
        last.weight[:], last.bias[:] = 0, 0
        last.weight[0, : triangle.numel()] = triangle

    @property
    def _weights(self) -> list[tuple[torch.Tensor, torch.Tensor]]:
        return [(layer.weight, layer.bias) for layer in self.layers if isinstance(layer, nn.Linear)]

    def kernel(self, u: torch.Tensor) -> torch.Tensor:
        """Return the values of the kernel f at positions `u` [...], in the same shape."""
        found = u[..., None]
        for number, (weight, bias) in enumerate(self._weights):
            found = F.linear(found, weight.to(u.dtype), bias.to(u.dtype))
            found = F.leaky_relu(found, SLOPE) if number < len(self.layers) - 1 else found
        return found[..., 0]

    def forward(self, events: EventBatch) -> torch.Tensor:
        """Return the tensors of a batch, float32 [B, 2 C, H, W]."""
        columns, rows = events.sensor_size
        edges = self._edges()
        left, width = edges[:-1], np.diff(edges)
        device = self._weights[0][0].device
        near, far = (torch.from_numpy(left + share * width).to(device) for share in (0.25, 0.75))
        at_near, at_far = self.kernel(near), self.kernel(far)
        slope = (at_far - at_near) / (far - near)
        line = torch.stack((at_near - slope * near, slope), 1)
        shape = len(events), 2, self.bins, rows, columns
        out: torch.Tensor = _Splat.apply(line, events, edges[1:], shape)  # type: ignore[no-untyped-call]
        return out.flatten(1, 2)

    @torch.no_grad()
    def _edges(self) -> np.ndarray:
        """Return the ends of the P linear pieces of f in [-1, 1], where the input of a unit is 0: float64 [P + 1]."""
        places = np.array([-1.0, 1.0])
        weights = [
            (weight.double().numpy(force=True), bias.double().numpy(force=True)) for weight, bias in self._weights
        ]
        for depth in range(1, len(weights)):
            found = places[:, None]
            for number, (weight, bias) in enumerate(weights[:depth]):
                found = found @ weight.T + bias
                if number < depth - 1:
                    found = np.where(found > 0, found, SLOPE * found)
            low, high = found[:-1], found[1:]
            piece, unit = np.nonzero(low * high < 0)
            a, b = low[piece, unit], high[piece, unit]
            roots = places[piece] + (places[piece + 1] - places[piece]) * (a / (a - b))
            places = np.unique(np.concatenate((places, roots)))
        inner = places[1:-1][np.diff(places)[:-1] > NARROW]
        inner = inner[inner < 1 - NARROW]
        return np.concatenate(([-1.0], inner, [1.0]))


class _Splat(torch.autograd.Function):
    """`splat` with gradients. It runs on the CPU; its inputs may be on any device."""

    @staticmethod
    def forward(
        ctx: Any, line: torch.Tensor, events: EventBatch, ends: np.ndarray, shape: tuple[int, ...]
    ) -> torch.Tensor:
        nearby = np.searchsorted(ends, np.linspace(-1, 1, LOOKUP + 1)).clip(max=ends.size - 1).astype(np.int32)
        # rounding may move a position at the last end beyond it
        ctx.ends, ctx.nearby = np.append(ends[:-1], np.inf), nearby
        named = (events.t, events.x, events.y, events.p, events.offsets)
        ctx.columns = tuple(column.numpy(force=True) for column in named)
        t, x, y, p, offsets = ctx.columns
        height, width = shape[3:]
        if not inside(t, x, y, p, width, height) or (np.diff(offsets, prepend=0, append=t.size) < 0).any():
            raise ValueError(
                f"the batch has events outside {width}x{height} pixels, or offsets outside its {t.size} events"
            )
        out = np.zeros(shape, np.float32)
        splat(t, x, y, p, offsets, ctx.ends, nearby, line.detach().double().numpy(force=True), out)
        return torch.from_numpy(out).to(line.device)

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, None, None, None]:
        t, x, y, p, offsets = ctx.columns
        found = np.zeros((ctx.ends.size, 2))
        wanted = gradient.float().contiguous().numpy(force=True)
        splat_gradient(t, x, y, p, offsets, ctx.ends, ctx.nearby, wanted, found)
        return torch.from_numpy(found).to(gradient.device), None, None, None
