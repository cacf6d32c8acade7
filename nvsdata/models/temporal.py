"""3D CNNs on sequences of grids (thesis, sections 5.2.4 and 5.3.1): plain, inception, residual."""

from __future__ import annotations

from collections.abc import Sequence

from torch import nn

from nvsdata.models.blocks import Residual, Streams
from nvsdata.models.norm import BatchNorm

Pair = tuple[int, int]


class Conv3D(nn.Sequential):
    """Convolution, batch normalization and ReLU: [B, in, T, H, W] to [B, out, T, H, W]."""

    def __init__(self, in_channels: int, out_channels: int, kernel_size: int = 3) -> None:
        super().__init__(
            nn.Conv3d(in_channels, out_channels, kernel_size, padding=kernel_size // 2, bias=False),
            BatchNorm(out_channels),
            nn.ReLU(inplace=True),
        )


def inception(in_channels: int, streams: tuple[int, Pair, Pair, int]) -> Streams:
    """Return I3D's block of four parallel streams with widths `streams`, in the notation of the thesis, section 5.3.1.

    The streams are a convolution of 1x1x1; twice 1x1x1 followed by 3x3x3; and a maximum over 3x3x3 followed by 1x1x1.
    """
    one, (two, two_out), (three, three_out), four = streams
    return Streams(
        Conv3D(in_channels, one, 1),
        nn.Sequential(Conv3D(in_channels, two, 1), Conv3D(two, two_out)),
        nn.Sequential(Conv3D(in_channels, three, 1), Conv3D(three, three_out)),
        nn.Sequential(nn.MaxPool3d(3, 1, padding=1), Conv3D(in_channels, four, 1)),
    )


def inception_width(streams: tuple[int, Pair, Pair, int]) -> int:
    """Return the number of output channels of `inception(..., streams)`."""
    one, (_, two), (_, three), four = streams
    return one + two + three + four


def residual(in_channels: int, inter_channels: int, out_channels: int) -> Residual:
    """Return the block Res(c_in, c_inter, c_out): two convolutions plus a 1x1x1 shortcut, all normalized, then ReLU."""
    second = nn.Conv3d(inter_channels, out_channels, 3, padding=1, bias=False), BatchNorm(out_channels)
    body = nn.Sequential(Conv3D(in_channels, inter_channels), *second)
    shortcut = nn.Conv3d(in_channels, out_channels, 1, bias=False), BatchNorm(out_channels)
    return Residual(body, nn.Sequential(*shortcut))


# widths of the blocks Inc_1 to Inc_4 (thesis, section 5.3.1)
INCEPTION: Sequence[tuple[int, Pair, Pair, int]] = (
    (128, (128, 192), (32, 96), 64),
    (192, (96, 208), (16, 48), 64),
    (160, (112, 224), (24, 64), 64),
    (128, (128, 256), (24, 64), 64),
)
TEMPORAL = ("plain", "inception", "residual")


def scaled(channels: int, width: float) -> int:
    """Return the number of channels times `width`, at least 1."""
    return max(1, round(channels * width))


def temporal_network(kind: str, in_channels: int = 128, width: float = 1.0) -> tuple[nn.Sequential, int]:
    """Return a 3D CNN up to its last pooling, and its number of output channels. ValueError for an unknown kind.

    `width` multiplies the channels of all layers.

    Each block is followed by a pooling of 2 x 2 x 2 with stride 2. After the first block, the stride in time is 1.
    Output sizes are rounded up, because 8 grids wouldn't suffice for four poolings otherwise.
    """
    blocks: list[nn.Module] = []
    before = in_channels
    if kind == "plain":
        for out in (scaled(full, width) for full in (128, 256, 512, 512)):
            blocks.append(Conv3D(before, out))
            before = out
    elif kind == "inception":
        for one, two, three, four in INCEPTION:
            pairs = [(scaled(a, width), scaled(b, width)) for a, b in (two, three)]
            streams = scaled(one, width), pairs[0], pairs[1], scaled(four, width)
            blocks.append(inception(before, streams))
            before = inception_width(streams)
    elif kind == "residual":
        for inter, out in ((256, 512), (512, 1024)):
            blocks.append(residual(before, scaled(inter, width), scaled(out, width)))
            before = scaled(out, width)
    else:
        raise ValueError(f"temporal must be one of {TEMPORAL}, not {kind!r}")
    layers: list[nn.Module] = []
    for n, block in enumerate(blocks):
        # sizes along T, H, W
        layers += [block, nn.MaxPool3d(2, (2 if n else 1, 2, 2), ceil_mode=True)]
    return nn.Sequential(*layers), before
