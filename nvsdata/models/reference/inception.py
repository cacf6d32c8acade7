"""Inception-v4 (Szegedy et al. 2017) and I3D (Carreira and Zisserman 2017); thesis, appendices A and B."""

from __future__ import annotations

import torch
from torch import nn

from nvsdata.models.blocks import Streams
from nvsdata.models.distributed import Dropout
from nvsdata.models.reference.layers import Classifier, Sizes, conv
from nvsdata.models.registry import register_network
from nvsdata.models.temporal import Conv3D, inception, inception_width

LEAST = 75  # pixels along the smaller side: smaller images have no pixels left before the last reduction


def _chain(in_channels: int, *layers: tuple[int, Sizes] | tuple[int, Sizes, int]) -> nn.Sequential:
    """Return a chain of convolutions, each with batch normalization and ReLU.

    (channels, size) has padding that keeps height and width, (channels, size, stride) has no padding.
    """
    chain = []
    for width, size, *stride in layers:
        kernel = (size, size) if isinstance(size, int) else size
        padding = (0, 0) if stride else (kernel[0] // 2, kernel[1] // 2)
        chain.append(conv(2, in_channels, width, kernel, stride[0] if stride else 1, padding))
        in_channels = width
    return nn.Sequential(*chain)


def _averaged(in_channels: int, out_channels: int) -> nn.Sequential:
    return nn.Sequential(nn.AvgPool2d(3, 1, 1, count_include_pad=False), _chain(in_channels, (out_channels, 1)))


def _stem(in_channels: int) -> nn.Sequential:
    return nn.Sequential(
        _chain(in_channels, (32, 3, 2), (32, 3, 1), (64, 3)),
        Streams(nn.MaxPool2d(3, 2), _chain(64, (96, 3, 2))),
        Streams(
            _chain(160, (64, 1), (96, 3, 1)),
            _chain(160, (64, 1), (64, (1, 7)), (64, (7, 1)), (96, 3, 1)),
        ),
        Streams(_chain(192, (192, 3, 2)), nn.MaxPool2d(3, 2)),
    )


def _a() -> nn.Module:
    return Streams(
        _chain(384, (96, 1)),
        _chain(384, (64, 1), (96, 3)),
        _chain(384, (64, 1), (96, 3), (96, 3)),
        _averaged(384, 96),
    )


def _b() -> nn.Module:
    return Streams(
        _chain(1024, (384, 1)),
        _chain(1024, (192, 1), (224, (1, 7)), (256, (7, 1))),
        _chain(1024, (192, 1), (192, (7, 1)), (224, (1, 7)), (224, (7, 1)), (256, (1, 7))),
        _averaged(1024, 128),
    )


def _c() -> nn.Module:
    def split(width: int) -> nn.Module:
        return Streams(_chain(width, (256, (1, 3))), _chain(width, (256, (3, 1))))

    return Streams(
        _chain(1536, (256, 1)),
        nn.Sequential(_chain(1536, (384, 1)), split(384)),
        nn.Sequential(_chain(1536, (384, 1), (448, (3, 1)), (512, (1, 3))), split(512)),
        _averaged(1536, 256),
    )


def _reduction_a() -> nn.Module:
    return Streams(nn.MaxPool2d(3, 2), _chain(384, (384, 3, 2)), _chain(384, (192, 1), (224, 3), (256, 3, 2)))


def _reduction_b() -> nn.Module:
    return Streams(
        nn.MaxPool2d(3, 2),
        _chain(1024, (192, 1), (192, 3, 2)),
        _chain(1024, (256, 1), (256, (1, 7)), (320, (7, 1)), (320, 3, 2)),
    )


@register_network("inception-v4")
class InceptionV4(Classifier):
    """Inception-v4 (Szegedy et al. 2017; thesis, figs. A.1, A.2).

    The network takes [B, in_channels, H, W] of at least 75x75 and returns class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        in_channels: Channels of an image (default 2).
        dropout: Probability of dropout before the last layer (default 0.2).

    Raises:
        ValueError: For inputs of another shape, and for images smaller than 75x75.

    Example:
        >>> from nvsdata import models
        >>> models.NETWORKS["inception-v4"] is models.reference.InceptionV4
        True
    """

    def __init__(self, num_classes: int, *, in_channels: int = 2, dropout: float = 0.2) -> None:
        modules = [_a() for _ in range(4)] + [_reduction_a()] + [_b() for _ in range(7)] + [_reduction_b()]
        modules += [_c() for _ in range(3)]
        classify = nn.Sequential(Dropout(dropout), nn.Linear(1536, num_classes))
        super().__init__(nn.Sequential(_stem(in_channels), *modules), classify, 2, in_channels)

    def features(self, x: torch.Tensor) -> torch.Tensor:
        """Return the output of the last layer before the mean, [B, 1536, H', W']. ValueError below 75x75 pixels."""
        if x.ndim == 4 and min(x.shape[2:]) < LEAST:
            raise ValueError(f"images of {x.shape[3]}x{x.shape[2]} are too small, the minimum is {LEAST}x{LEAST}")
        return super().features(x)


# Inception-v1's modules between the poolings, each as the `streams` of `inception`
I3D_MODULES = (
    ((64, (96, 128), (16, 32), 32), (128, (128, 192), (32, 96), 64)),
    (
        (192, (96, 208), (16, 48), 64),
        (160, (112, 224), (24, 64), 64),
        (128, (128, 256), (24, 64), 64),
        (112, (144, 288), (32, 64), 64),
        (256, (160, 320), (32, 128), 128),
    ),
    ((256, (160, 320), (32, 128), 128), (384, (192, 384), (48, 128), 128)),
)


@register_network("i3d")
class I3D(Classifier):
    """I3D (Carreira and Zisserman 2017; thesis, fig. B.1): Inception-v1 inflated to three dimensions.

    The network takes [B, in_channels, T, H, W] with T at least 8 and returns class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        in_channels: Channels of a frame (default 2).
        dropout: Probability of dropout before the last layer (default 0.5).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> from nvsdata import models
        >>> models.NETWORKS["i3d"] is models.reference.I3D
        True
    """

    def __init__(self, num_classes: int, *, in_channels: int = 2, dropout: float = 0.5) -> None:
        layers: list[nn.Module] = [
            conv(3, in_channels, 64, 7, 2, 3),
            nn.MaxPool3d((1, 3, 3), (1, 2, 2), (0, 1, 1)),
            Conv3D(64, 64, 1),
            Conv3D(64, 192),
            nn.MaxPool3d((1, 3, 3), (1, 2, 2), (0, 1, 1)),
        ]
        poolings = [nn.MaxPool3d(3, 2, 1), nn.MaxPool3d(2, 2), None]
        width = 192
        for modules, pooling in zip(I3D_MODULES, poolings, strict=True):
            for streams in modules:
                layers.append(inception(width, streams))
                width = inception_width(streams)
            if pooling is not None:
                layers.append(pooling)
        classify = nn.Sequential(Dropout(dropout), nn.Linear(width, num_classes))
        super().__init__(nn.Sequential(*layers), classify, 3, in_channels)
