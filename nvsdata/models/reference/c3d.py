"""3D CNNs without shortcuts: C3D (Tran et al. 2015; thesis B) and the motion-vector CNN (Chadha et al. 2017; 3.5.1)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

from nvsdata.models.distributed import Dropout
from nvsdata.models.reference.layers import Classifier, convolution, full
from nvsdata.models.registry import register_network

# convolutions between poolings
C3D_WIDTHS = ((64,), (128,), (256, 256), (512, 512), (512, 512))


@register_network("c3d")
class C3D(Classifier):
    """3x3x3 convolutions with ReLU, five poolings, of which the first leaves time alone, and two hidden layers.

    Takes [B, in_channels, T, H, W]: 16 x 112 x 112, as the fully connected layers do. Other sizes are
    averaged to theirs, [1, 4, 4]. Poolings keep what is over at an edge, so that 8 frames last for them.
    """

    def __init__(self, num_classes: int, *, in_channels: int = 2, hidden: int = 4096, dropout: float = 0.5) -> None:
        layers: list[nn.Module] = []
        before = in_channels
        for n, widths in enumerate(C3D_WIDTHS):
            for width in widths:
                layers += [convolution(3, before, width, 3, padding=1), nn.ReLU(inplace=True)]
                before = width
            layers.append(nn.MaxPool3d((2 if n else 1, 2, 2), ceil_mode=True))
        classify = full(before * 16, hidden, hidden, num_classes, dropout=dropout)
        super().__init__(nn.Sequential(*layers), classify, 3, in_channels)
        self.pool = nn.AdaptiveAvgPool3d((1, 4, 4))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Class scores (logits) [B, num_classes]."""
        scores: torch.Tensor = self.classify(self.pool(self.features(x)).flatten(1))
        return scores


@register_network("motion-vector-3d")
class MotionVector3D(Classifier):
    """The 3D CNN of section 3.5.1, for long volumes of few pixels: [B, in_channels, frames, size, size], 160 x 24 x 24.

    Of one channel, [B, frames, size, size] will do.

    Convolutions of 3x3x3 with a pooling of 2x2x2 each, two hidden layers with dropout, parametric ReLUs throughout. The
    thesis refers to the paper for the widths; those here are ours, of the order of weights that it states, a
    third of an optical-flow network's. ValueError for volumes of another size.
    """

    def __init__(
        self,
        num_classes: int,
        *,
        frames: int = 160,
        size: int = 24,
        in_channels: int = 1,
        widths: Sequence[int] = (64, 128, 256, 256),
        hidden: int = 2048,
        dropout: float = 0.8,
    ) -> None:
        layers: list[nn.Module] = []
        before, shape = in_channels, [frames, size, size]
        for width in widths:
            layers += [convolution(3, before, width, 3, padding=1), nn.PReLU(), nn.MaxPool3d(2, ceil_mode=True)]
            before, shape = width, [-(-side // 2) for side in shape]
        places = shape[0] * shape[1] * shape[2]
        classify = nn.Sequential(
            nn.Linear(before * places, hidden),
            nn.PReLU(),
            Dropout(dropout),
            nn.Linear(hidden, hidden),
            nn.PReLU(),
            Dropout(dropout),
            nn.Linear(hidden, num_classes),
        )
        super().__init__(nn.Sequential(*layers), classify, 3, in_channels)
        self.shape = (frames, size, size)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Class scores (logits) [B, num_classes]."""
        if x.ndim == 4 and self.in_channels == 1:
            x = x.unsqueeze(1)
        if x.shape[2:] != self.shape:
            raise ValueError(f"the network takes volumes of {list(self.shape)} (T, H, W), not {list(x.shape[2:])}")
        scores: torch.Tensor = self.classify(self.features(x).flatten(1))
        return scores
