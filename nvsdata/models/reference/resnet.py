"""Residual networks in two and three dimensions.

ResNet (He et al. 2016), 3D ResNet and ResNeXt (Hara et al. 2018) and R(2+1)D (Tran et al. 2018): thesis, appendices A
and B.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from torch import nn

from nvsdata.models.blocks import Residual
from nvsdata.models.norm import BatchNorm
from nvsdata.models.reference.layers import Classifier, conv, convolution
from nvsdata.models.registry import register_network

WIDTHS = (64, 128, 256, 512)

Block = Callable[[int, int, int], tuple[nn.Module, int]]


def bottleneck(
    dimensions: int, in_channels: int, width: int, stride: int, *, expansion: int = 4, groups: int = 1
) -> tuple[nn.Module, int]:
    """Return a block of convolutions of size 1, 3 and 1, and its number of output channels.

    The stride is that of the first convolution or, with groups, of the second.
    """
    out = width * expansion
    first, second = (stride, 1) if groups == 1 else (1, stride)
    body = nn.Sequential(
        conv(dimensions, in_channels, width, 1, first),
        conv(dimensions, width, width, 3, second, 1, groups=groups),
        conv(dimensions, width, out, 1, relu=False),
    )
    return Residual(body, _shortcut(dimensions, in_channels, out, stride)), out


def basic3d(in_channels: int, width: int, stride: int) -> tuple[nn.Module, int]:
    """Return a block of two 3x3x3 convolutions, and its number of output channels."""
    body = nn.Sequential(conv(3, in_channels, width, 3, stride, 1), conv(3, width, width, 3, 1, 1, relu=False))
    return Residual(body, _shortcut(3, in_channels, width, stride)), width


def factored(in_channels: int, width: int, stride: int) -> tuple[nn.Module, int]:
    """Return a block of two (2+1)D convolutions, and its number of output channels."""
    body = nn.Sequential(
        *two_plus_one(in_channels, width, stride), nn.ReLU(inplace=True), *two_plus_one(width, width, 1)
    )
    return Residual(body, _shortcut(3, in_channels, width, stride)), width


def two_plus_one(in_channels: int, out_channels: int, stride: int) -> tuple[nn.Module, ...]:
    """Return layers for space, then time: 1x3x3, batch normalization and ReLU, 3x1x1 and batch normalization.

    The number of channels between the two convolutions is such that together they have as many weights as a 3x3x3
    convolution (Tran et al. 2018, section 3.5).
    """
    between = 27 * in_channels * out_channels // (9 * in_channels + 3 * out_channels)
    return (
        conv(3, in_channels, between, (1, 3, 3), (1, stride, stride), (0, 1, 1)),
        convolution(3, between, out_channels, (3, 1, 1), (stride, 1, 1), (1, 0, 0), bias=False),
        BatchNorm(out_channels),
    )


def stages(block: Block, in_channels: int, depths: Sequence[int], widths: Sequence[int]) -> tuple[nn.Sequential, int]:
    """Return blocks in stages, and their number of output channels. Each stage but the first halves the size."""
    layers: list[nn.Module] = []
    for stage, (depth, width) in enumerate(zip(depths, widths, strict=True)):
        for n in range(depth):
            layer, in_channels = block(in_channels, width, 2 if stage and not n else 1)
            layers.append(layer)
    return nn.Sequential(*layers), in_channels


def _shortcut(dimensions: int, in_channels: int, out_channels: int, stride: int) -> nn.Module | None:
    if stride == 1 and in_channels == out_channels:
        return None
    return conv(dimensions, in_channels, out_channels, 1, stride, relu=False)


@register_network("resnet")
class ResNet(Classifier):
    """ResNet-50 (He et al. 2016; thesis, Table A.1).

    The network takes [B, in_channels, H, W] and returns class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        depths: Blocks of each of the four stages (default (3, 4, 6, 3)).
        in_channels: Channels of an image (default 2).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> models.reference.ResNet(11, depths=(1, 1, 1, 1)).eval()(torch.zeros(1, 2, 32, 32)).shape
        torch.Size([1, 11])
    """

    def __init__(self, num_classes: int, *, depths: Sequence[int] = (3, 4, 6, 3), in_channels: int = 2) -> None:
        stem = nn.Sequential(conv(2, in_channels, 64, 7, 2, 3), nn.MaxPool2d(3, 2, 1))
        body, width = stages(partial(bottleneck, 2), 64, depths, WIDTHS)
        super().__init__(nn.Sequential(stem, body), nn.Linear(width, num_classes), 2, in_channels)


def _stem3d(in_channels: int) -> nn.Sequential:
    return nn.Sequential(conv(3, in_channels, 64, 7, (1, 2, 2), 3), nn.MaxPool3d(3, 2, 1))


@register_network("resnet3d")
class ResNet3D(Classifier):
    """3D ResNet with 34 layers (Hara et al. 2018; thesis, Table B.1).

    The network takes [B, in_channels, T, H, W] and returns class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        depths: Blocks of each of the four stages (default (3, 4, 6, 3)).
        in_channels: Channels of a frame (default 2).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> from nvsdata import models
        >>> models.NETWORKS["resnet3d"] is models.reference.ResNet3D
        True
    """

    def __init__(self, num_classes: int, *, depths: Sequence[int] = (3, 4, 6, 3), in_channels: int = 2) -> None:
        body, width = stages(basic3d, 64, depths, WIDTHS)
        super().__init__(nn.Sequential(_stem3d(in_channels), body), nn.Linear(width, num_classes), 3, in_channels)


@register_network("resnext3d")
class ResNeXt3D(Classifier):
    """3D ResNeXt with 50 layers (Hara et al. 2018; thesis, fig. B.2), with wider bottlenecks and grouped convolutions.

    The network takes [B, in_channels, T, H, W] and returns class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        depths: Blocks of each of the four stages (default (3, 4, 6, 3)).
        groups: Groups of the 3x3x3 convolutions (default 32).
        in_channels: Channels of a frame (default 2).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> from nvsdata import models
        >>> models.NETWORKS["resnext3d"] is models.reference.ResNeXt3D
        True
    """

    def __init__(
        self, num_classes: int, *, depths: Sequence[int] = (3, 4, 6, 3), groups: int = 32, in_channels: int = 2
    ) -> None:
        block = partial(bottleneck, 3, expansion=2, groups=groups)
        body, width = stages(block, 64, depths, [2 * width for width in WIDTHS])
        super().__init__(nn.Sequential(_stem3d(in_channels), body), nn.Linear(width, num_classes), 3, in_channels)


@register_network("r2plus1d")
class R2Plus1D(Classifier):
    """R(2+1)D (Tran et al. 2018): each 3D convolution is split into one in space and one in time.

    The thesis counts 36 layers, because it counts both parts. The 33 million parameters in its Table 5.3 show that
    there are 18 pairs. The network takes [B, in_channels, T, H, W] and returns class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        depths: Blocks of each of the four stages (default (2, 2, 2, 2)).
        in_channels: Channels of a frame (default 2).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> from nvsdata import models
        >>> models.NETWORKS["r2plus1d"] is models.reference.R2Plus1D
        True
    """

    def __init__(self, num_classes: int, *, depths: Sequence[int] = (2, 2, 2, 2), in_channels: int = 2) -> None:
        stem = nn.Sequential(
            conv(3, in_channels, 45, (1, 7, 7), (1, 2, 2), (0, 3, 3)), conv(3, 45, 64, (3, 1, 1), 1, (1, 0, 0))
        )
        body, width = stages(factored, 64, depths, WIDTHS)
        super().__init__(nn.Sequential(stem, body), nn.Linear(width, num_classes), 3, in_channels)
