"""Graph networks for inference: normalization and shortcuts are folded into the convolutions."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import TypeVar

import torch
from torch import nn

from nvsdata.data.graph import GraphBatch
from nvsdata.models.graph_cnn import ConvBlock, Kernel, ResidualBlock
from nvsdata.models.norm import BatchNorm
from nvsdata.models.spline import SplineConv

Network = TypeVar("Network", bound=nn.Module)


@torch.no_grad()
def fused(model: Network) -> Network:
    """Return a copy of a trained network for inference, with the same outputs up to rounding and less computation.

    Each block of B-spline convolutions becomes a single convolution, normalized by the running statistics. The hat
    functions of a kernel add up to 1 everywhere, so a shortcut of kernel size 1 is a matrix that is added to the
    weights of each cell. Blocks of other convolutions and 3D CNNs are copied unchanged.

    Args:
        model: Network with `ConvBlock` or `ResidualBlock`, such as `RGCNN`. It isn't changed.

    Returns:
        The copy, in evaluation mode. It can be neither trained nor saved.

    Example:
        >>> from nvsdata import models
        >>> model = models.rgcnn("n-mnist").eval()
        >>> sum(p.numel() for p in models.fused(model).parameters()) < sum(p.numel() for p in model.parameters())
        True
    """
    model = deepcopy(model)
    for parent in list(model.modules()):
        for name, block in parent.named_children():
            if isinstance(block, ResidualBlock) and isinstance(block.conv, SplineConv):
                _fold(block.conv, block.norm)
                _fold(block.shortcut, block.shortcut_norm)
                _add(block.conv, block.shortcut)
                setattr(parent, name, _Block(block.conv, block.kernel))
            elif isinstance(block, ConvBlock) and isinstance(block.conv, SplineConv):
                _fold(block.conv, block.norm)
                setattr(parent, name, _Block(block.conv, block.kernel))
    # `save` recognizes networks by `kind`, and refuses this one
    model.kind = None  # type: ignore[assignment]
    return model.eval().requires_grad_(False)


class _Block(nn.Module):
    """A block reduced to its convolution."""

    def __init__(self, conv: SplineConv, kernel: Kernel) -> None:
        super().__init__()
        self.conv, self.kernel = conv, kernel

    def forward(self, batch: GraphBatch) -> GraphBatch:
        return replace(batch, x=self.conv(batch.x, *self.kernel.edges(batch, self.conv)))


def _fold(conv: SplineConv, norm: BatchNorm) -> None:
    """Fold the normalization that follows a convolution into its weights."""
    assert conv.bias is not None
    assert norm.running_mean is not None
    assert norm.running_var is not None
    scale = norm.weight * (norm.running_var + norm.eps).rsqrt()
    conv.weight.mul_(scale)
    conv.bias.sub_(norm.running_mean).mul_(scale).add_(norm.bias)
    if conv.root is not None:
        conv.root.mul_(scale)


def _add(conv: SplineConv, shortcut: SplineConv) -> None:
    """Add a shortcut's weights to a convolution, so that the convolution returns the sum of both."""
    assert conv.bias is not None
    assert shortcut.bias is not None
    conv.weight.add_(shortcut.weight)
    conv.bias.add_(shortcut.bias)
    if conv.root is not None:
        assert shortcut.root is not None
        conv.root.add_(shortcut.root)
