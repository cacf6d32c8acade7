"""Blocks of convolutional networks, in two or three dimensions."""

from __future__ import annotations

import torch
from torch import nn


class Streams(nn.Module):
    """Parallel layers on the same input, with their outputs concatenated along the channels (an inception module)."""

    def __init__(self, *streams: nn.Module) -> None:
        super().__init__()
        self.streams = nn.ModuleList(streams)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return the concatenated outputs: [B, C, ...] to [B, sum of the streams' channels, ...]."""
        return torch.cat([stream(x) for stream in self.streams], 1)


class Residual(nn.Module):
    """Residual block relu(body(x) + shortcut(x)) (He et al. 2016)."""

    def __init__(self, body: nn.Module, shortcut: nn.Module | None = None) -> None:
        super().__init__()
        self.body, self.shortcut = body, shortcut or nn.Identity()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return relu(body(x) + shortcut(x)): [B, in, ...] to [B, out, ...]."""
        return torch.relu(self.body(x) + self.shortcut(x))
