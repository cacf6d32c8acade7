"""Layers shared by the convolutional reference networks, in two or three dimensions."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import torch
from torch import nn

from nvsdata.models.distributed import Dropout
from nvsdata.models.norm import BatchNorm

Sizes = int | tuple[int, ...]


def convolution(dimensions: int, *arguments: Any, **options: Any) -> nn.Module:
    """Return `nn.Conv2d` or `nn.Conv3d` with the initialization of He et al. (2015) for layers before a ReLU."""
    layer = (nn.Conv2d if dimensions == 2 else nn.Conv3d)(*arguments, **options)
    nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")
    return layer


def conv(
    dimensions: int,
    in_channels: int,
    out_channels: int,
    kernel_size: Sizes,
    stride: Sizes = 1,
    padding: Sizes = 0,
    *,
    groups: int = 1,
    relu: bool = True,
) -> nn.Sequential:
    """Return a convolution without bias, batch normalization and, unless `relu` is False, ReLU."""
    layers = [
        convolution(dimensions, in_channels, out_channels, kernel_size, stride, padding, groups=groups, bias=False),
        BatchNorm(out_channels),
    ]
    return nn.Sequential(*layers, nn.ReLU(inplace=True)) if relu else nn.Sequential(*layers)


def full(*widths: int, dropout: float = 0.5) -> nn.Sequential:
    """Return fully connected layers with ReLU and dropout between them."""
    layers: list[nn.Module] = []
    for a, b in pairwise(widths[:-1]):
        layers += [nn.Linear(a, b), nn.ReLU(inplace=True), Dropout(dropout)]
    return nn.Sequential(*layers, nn.Linear(widths[-2], widths[-1]))


class Classifier(nn.Module):
    """Network in two parts: `maps` computes feature maps, `classify` computes scores from their mean over positions."""

    def __init__(self, maps: nn.Module, classify: nn.Module, dimensions: int, in_channels: int) -> None:
        super().__init__()
        self.maps, self.classify = maps, classify
        self.dimensions, self.in_channels = dimensions, in_channels

    def features(self, x: torch.Tensor) -> torch.Tensor:
        """Return the output of the last layer before the mean: [B, C, H, W] or [B, C, T, H, W]."""
        named = "[B, C, H, W]" if self.dimensions == 2 else "[B, C, T, H, W]"
        if x.ndim != self.dimensions + 2 or x.shape[1] != self.in_channels:
            raise ValueError(f"the network takes {named} with C = {self.in_channels}, not {list(x.shape)}")
        maps: torch.Tensor = self.maps(x)
        return maps

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return class scores (logits) [B, num_classes]. ValueError for another shape than the network takes."""
        scores: torch.Tensor = self.classify(self.features(x).flatten(2).mean(2))
        return scores
