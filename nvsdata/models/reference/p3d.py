"""Pseudo-3D residual network (Qiu et al. 2017; thesis, appendix B)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import torch
from torch import nn

from nvsdata.models.blocks import Residual
from nvsdata.models.reference.layers import Classifier, conv
from nvsdata.models.registry import register_network

Variant = Literal["A", "B", "C", "2D"]


class SpaceTime(nn.Module):
    """Convolutions S (1x3x3) and T (3x1x1), combined by `variant`.

    A is T(S(x)), B is S(x) + T(x), C is S(x) + T(S(x)), 2D is S(x).
    """

    def __init__(self, width: int, variant: Variant) -> None:
        super().__init__()
        self.variant = variant
        self.space = conv(3, width, width, (1, 3, 3), 1, (0, 1, 1))
        self.time = conv(3, width, width, (3, 1, 1), 1, (1, 0, 0)) if variant != "2D" else None

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return an output of the shape of the input, [B, C, T, H, W]."""
        s: torch.Tensor = self.space(x)
        if self.time is None:
            return s
        t: torch.Tensor = self.time(x if self.variant == "B" else s)
        return t if self.variant == "A" else s + t


def _bottleneck(in_channels: int, width: int, stride: int, variant: Variant) -> nn.Module:
    strides = (1, stride, stride)
    body = nn.Sequential(
        conv(3, in_channels, width, 1, strides),
        SpaceTime(width, variant),
        conv(3, width, 4 * width, 1, relu=False),
    )
    same = stride == 1 and in_channels == 4 * width
    return Residual(body, None if same else conv(3, in_channels, 4 * width, 1, strides, relu=False))


@register_network("p3d")
class P3D(Classifier):
    """P3D-63 (Qiu et al. 2017; thesis, appendix B): ResNet-50's bottlenecks with `SpaceTime` A, B and C alternating.

    The number of frames is halved after the stem and after each of the first three stages. The last stage has only 2D
    convolutions. The network takes [B, in_channels, T, H, W] and returns class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        depths: Blocks of each stage (default (3, 4, 6, 3)).
        in_channels: Channels of a frame (default 2).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> models.reference.P3D(11, depths=(1, 1)).eval()(torch.zeros(1, 2, 8, 16, 16)).shape
        torch.Size([1, 11])
    """

    def __init__(self, num_classes: int, *, depths: Sequence[int] = (3, 4, 6, 3), in_channels: int = 2) -> None:
        layers: list[nn.Module] = [
            conv(3, in_channels, 64, (1, 7, 7), (1, 2, 2), (0, 3, 3)),
            nn.MaxPool3d((2, 3, 3), 2, (0, 1, 1), ceil_mode=True),
        ]
        variants: tuple[Variant, ...] = ("A", "B", "C")
        before, blocks = 64, 0
        for stage, depth in enumerate(depths):
            last = stage == len(depths) - 1
            width = 64 << stage
            for n in range(depth):
                variant = "2D" if last else variants[blocks % 3]
                layers.append(_bottleneck(before, width, 2 if stage and not n else 1, variant))
                before, blocks = 4 * width, blocks + 1
            if not last:
                layers.append(nn.MaxPool3d((2, 1, 1), (2, 1, 1), ceil_mode=True))
        super().__init__(nn.Sequential(*layers), nn.Linear(before, num_classes), 3, in_channels)
