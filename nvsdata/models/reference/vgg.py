"""VGG (Simonyan and Zisserman 2015), for event images and stacks of three frames.

The thesis uses VGG in sections 4.4.4 and 3.5.2 (see also appendix A).
"""

from __future__ import annotations

import torch
from torch import nn

from nvsdata.models.reference.layers import Classifier, convolution, full
from nvsdata.models.registry import register_network

# by number of layers with weights: numbers of convolutions before each maximum pooling
DEPTHS = {16: (2, 2, 3, 3, 3), 19: (2, 2, 4, 4, 4)}
WIDTHS = (64, 128, 256, 512, 512)


@register_network("vgg")
class VGG(Classifier):
    """VGG (Simonyan and Zisserman 2015): 3x3 convolutions with ReLU, five poolings, three fully connected layers.

    The network takes [B, in_channels, H, W] and returns class scores (logits) [B, num_classes]. It is designed for
    224x224. Feature maps of other sizes are averaged to the 7x7 that the fully connected layers take.

    Args:
        num_classes: Number of scores.
        layers: 16 or 19 (default 19).
        in_channels: Channels of an image (default 2). Section 4.4.4 of the thesis uses two channels, ON and OFF counts;
            section 3.5.2 (VGG-16) uses three consecutive frames of summed polarity.
        hidden: Width of the hidden layers (default 4096).
        dropout: Probability of dropout after the hidden layers (default 0.5; 0.8 in section 3.5.2 of the thesis).

    Raises:
        ValueError: For another number of layers or inputs of another shape.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> models.reference.VGG(11, layers=16, hidden=16).eval()(torch.zeros(1, 2, 32, 32)).shape
        torch.Size([1, 11])
    """

    def __init__(
        self, num_classes: int, *, layers: int = 19, in_channels: int = 2, hidden: int = 4096, dropout: float = 0.5
    ) -> None:
        if layers not in DEPTHS:
            raise ValueError(f"layers must be one of {tuple(DEPTHS)}, not {layers}")
        maps: list[nn.Module] = []
        before = in_channels
        for depth, width in zip(DEPTHS[layers], WIDTHS, strict=True):
            for _ in range(depth):
                maps += [convolution(2, before, width, 3, padding=1), nn.ReLU(inplace=True)]
                before = width
            maps.append(nn.MaxPool2d(2))
        classify = full(before * 49, hidden, hidden, num_classes, dropout=dropout)
        super().__init__(nn.Sequential(*maps), classify, 2, in_channels)
        self.pool = nn.AdaptiveAvgPool2d(7)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return class scores (logits) [B, num_classes]."""
        scores: torch.Tensor = self.classify(self.pool(self.features(x)).flatten(1))
        return scores
