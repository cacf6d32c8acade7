"""3D CNNs without shortcuts.

C3D (Tran et al. 2015; thesis, appendix B) and the motion-vector CNN (Chadha et al. 2017; thesis, section 3.5.1).
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

from nvsdata.models.distributed import Dropout
from nvsdata.models.reference.layers import Classifier, convolution, full
from nvsdata.models.registry import register_network

# widths of the convolutions between poolings
C3D_WIDTHS = ((64,), (128,), (256, 256), (512, 512), (512, 512))


@register_network("c3d")
class C3D(Classifier):
    """C3D (Tran et al. 2015): 3x3x3 convolutions with ReLU, five poolings (the first not in time), two hidden layers.

    The network takes [B, in_channels, T, H, W] and returns class scores (logits) [B, num_classes]. It is designed for
    16 x 112 x 112. Feature maps of other sizes are averaged to the [1, 4, 4] that the fully connected layers take.
    Poolings round sizes up, so 8 frames suffice.

    Args:
        num_classes: Number of scores.
        in_channels: Channels of a frame (default 2).
        hidden: Width of the hidden layers (default 4096).
        dropout: Probability of dropout after the hidden layers (default 0.5).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> from nvsdata import models
        >>> models.reference.C3D(11, hidden=16).classify[-1].out_features
        11
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
        """Return class scores (logits) [B, num_classes]."""
        scores: torch.Tensor = self.classify(self.pool(self.features(x)).flatten(1))
        return scores


@register_network("motion-vector-3d")
class MotionVector3D(Classifier):
    """Motion-vector CNN (Chadha et al. 2017; thesis, section 3.5.1), for long sequences of small frames.

    The network has 3x3x3 convolutions, each followed by a pooling of 2x2x2, and two hidden layers with dropout. All
    activations are parametric ReLUs. The thesis refers to the paper for the widths. The widths here are ours, chosen to
    give about the number of weights that the thesis states, a third of that of an optical-flow network.

    The network takes [B, in_channels, frames, size, size] or, with one channel, [B, frames, size, size]. It returns
    class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        frames: Frames of a sample (default 160).
        size: Side of a frame in pixels (default 24).
        in_channels: Channels of a frame (default 1).
        widths: Channels of the convolutions (default (64, 128, 256, 256)).
        hidden: Width of the hidden layers (default 2048).
        dropout: Probability of dropout after the hidden layers (default 0.8).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> model = models.reference.MotionVector3D(5, frames=16, widths=(4, 8), hidden=16).eval()
        >>> model(torch.zeros(1, 16, 24, 24)).shape
        torch.Size([1, 5])
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
        """Return class scores (logits) [B, num_classes]."""
        if x.ndim == 4 and self.in_channels == 1:
            x = x.unsqueeze(1)
        if x.shape[2:] != self.shape:
            raise ValueError(f"the network takes volumes of {list(self.shape)} (T, H, W), not {list(x.shape[2:])}")
        scores: torch.Tensor = self.classify(self.features(x).flatten(1))
        return scores
