"""Networks for events as points or as a sequence (thesis, Table 5.1): PointNet, PointNet++, LSTM.

They take [B, N, 4]: N events with x, y, t and polarity, as `T.Points` returns them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import nn

from nvsdata.models.distributed import Dropout
from nvsdata.models.norm import BatchNorm
from nvsdata.models.reference.layers import conv
from nvsdata.models.registry import register_network


def check_points(points: torch.Tensor, in_channels: int) -> None:
    """Raise ValueError unless the shape is [B, N, in_channels] with N > 0."""
    if points.ndim != 3 or points.shape[2] != in_channels or points.shape[1] == 0:
        raise ValueError(f"the network takes points [B, N, {in_channels}], not {list(points.shape)}")


def shared_mlp(*widths: int) -> nn.Sequential:
    """Return layers that are applied to each point: [B, C, ...] to [B, C', ...]."""
    return nn.Sequential(*(conv(2, a, b, 1) for a, b in pairwise(widths)))


def head(*widths: int, dropout: float) -> nn.Sequential:
    """Return fully connected layers with batch normalization and ReLU, and dropout before the last one."""
    layers: list[nn.Module] = []
    for a, b in pairwise(widths[:-1]):
        layers += [nn.Linear(a, b), BatchNorm(b), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers, Dropout(dropout), nn.Linear(widths[-2], widths[-1]))


class Alignment(nn.Module):
    """Matrix [size, size], computed from all points and applied to each (PointNet's T-Net); initially the identity."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self.size = size
        self.points = shared_mlp(size, 64, 128, 1024)
        self.matrix = head(1024, 512, 256, size * size, dropout=0.0)
        last = self.matrix[-1]
        assert isinstance(last, nn.Linear)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Transform points [B, size, N, 1]."""
        wide = self.points(x).amax((2, 3))
        matrix = self.matrix(wide).view(-1, self.size, self.size) + torch.eye(self.size, dtype=x.dtype, device=x.device)
        return torch.bmm(matrix, x.squeeze(3)).unsqueeze(3)


@register_network("pointnet")
class PointNet(nn.Module):
    """PointNet (Qi et al. 2017): points aligned, a shared MLP, maximum over points, three fully connected layers.

    The network takes points [B, N, in_channels] in any order and returns class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        in_channels: Features per point (default 4).
        dropout: Probability of dropout before the last layer (default 0.3).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> models.reference.PointNet(11).eval()(torch.rand(1, 16, 4)).shape
        torch.Size([1, 11])
    """

    def __init__(self, num_classes: int, *, in_channels: int = 4, dropout: float = 0.3) -> None:
        super().__init__()
        self.in_channels = in_channels
        self.points = nn.Sequential(
            Alignment(in_channels), shared_mlp(in_channels, 64, 64), Alignment(64), shared_mlp(64, 64, 128, 1024)
        )
        self.classify = head(1024, 512, 256, num_classes, dropout=dropout)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return class scores (logits) [B, num_classes] of points [B, N, in_channels], in any order."""
        check_points(points, self.in_channels)
        scores: torch.Tensor = self.classify(self.points(points.mT.unsqueeze(3)).amax((2, 3)))
        return scores


class Abstraction(nn.Module):
    """PointNet++'s set abstraction: distant centers, neighbors in a ball, an MLP and the maximum over each ball."""

    def __init__(self, centers: int, radius: float, neighbors: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.centers, self.radius, self.neighbors = centers, radius, neighbors
        self.mlp = shared_mlp(*widths)

    def forward(self, xyz: torch.Tensor, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return positions [B, M, 3] and features [B, M, C'] of centers, from [B, N, 3] and [B, N, C]."""
        chosen = farthest_points(xyz, min(self.centers, xyz.shape[1]))
        center = _at(xyz, chosen)
        apart = torch.cdist(center, xyz, compute_mode="donot_use_mm_for_euclid_dist")
        apart, near = apart.topk(min(self.neighbors, xyz.shape[1]), 2, largest=False)
        # points outside the ball are replaced by the nearest one, which is the center itself
        near = torch.where(apart <= self.radius, near, near[..., :1])
        index = near.flatten(1)
        shape = (*near.shape, -1)
        offset = _at(xyz, index).view(shape) - center.unsqueeze(2)
        grouped = torch.cat((offset, _at(features, index).view(shape)), 3)
        return center, self.mlp(grouped.permute(0, 3, 1, 2)).amax(3).mT


@register_network("pointnet++")
class PointNet2(nn.Module):
    """PointNet++ (Qi et al. 2017): set abstraction to 512 points, 128 and one, then three fully connected layers.

    The network takes points [B, N, in_channels] in any order and returns class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        in_channels: Features per point (default 4). The first three are coordinates, which `T.Points` scales to [0, 1].
        dropout: Probability of dropout before the last layer (default 0.5).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> models.reference.PointNet2(11).eval()(torch.rand(1, 16, 4)).shape
        torch.Size([1, 11])
    """

    def __init__(self, num_classes: int, *, in_channels: int = 4, dropout: float = 0.5) -> None:
        super().__init__()
        self.in_channels = in_channels
        extra = in_channels - 3
        self.first = Abstraction(512, 0.2, 32, (3 + extra, 64, 64, 128))
        self.second = Abstraction(128, 0.4, 64, (3 + 128, 128, 128, 256))
        self.whole = shared_mlp(3 + 256, 256, 512, 1024)
        self.classify = head(1024, 512, 256, num_classes, dropout=dropout)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return class scores (logits) [B, num_classes] of points [B, N, in_channels], in any order."""
        check_points(points, self.in_channels)
        xyz, features = self.second(*self.first(points[..., :3], points[..., 3:]))
        whole = self.whole(torch.cat((xyz, features), 2).mT.unsqueeze(3)).amax((2, 3))
        scores: torch.Tensor = self.classify(whole)
        return scores


@register_network("lstm")
class LSTM(nn.Module):
    """LSTM layers over the events in temporal order, and a fully connected layer on the last state.

    The network takes events [B, N, in_channels] in temporal order and returns class scores (logits) [B, num_classes].
    The thesis says only that its LSTM takes events as a sequence; the widths are ours.

    Args:
        num_classes: Number of scores.
        in_channels: Features per event (default 4).
        hidden: Width of the LSTM (default 256).
        layers: Number of LSTM layers (default 2).

    Raises:
        ValueError: For inputs of another shape.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> models.reference.LSTM(11).eval()(torch.rand(1, 16, 4)).shape
        torch.Size([1, 11])
    """

    def __init__(self, num_classes: int, *, in_channels: int = 4, hidden: int = 256, layers: int = 2) -> None:
        super().__init__()
        self.in_channels = in_channels
        self.lstm = nn.LSTM(in_channels, hidden, layers, batch_first=True)
        self.classify = nn.Linear(hidden, num_classes)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return class scores (logits) [B, num_classes] of events [B, N, in_channels] in temporal order."""
        check_points(points, self.in_channels)
        out, _ = self.lstm(points)
        scores: torch.Tensor = self.classify(out[:, -1])
        return scores


@torch.no_grad()
def farthest_points(xyz: torch.Tensor, count: int) -> torch.Tensor:
    """Return indices [B, count] of distant points.

    The first is the farthest from the mean; each further one is the farthest from those chosen so far.
    """
    batch = torch.arange(xyz.shape[0], device=xyz.device)
    apart = (xyz - xyz.mean(1, keepdim=True)).square().sum(2)
    chosen = torch.empty(xyz.shape[0], count, dtype=torch.int64, device=xyz.device)
    nearest = torch.full_like(apart, torch.inf)
    for n in range(count):
        index = (nearest if n else apart).argmax(1)
        chosen[:, n] = index
        offset = xyz - xyz[batch, index].unsqueeze(1)
        nearest = torch.minimum(nearest, offset.square().sum(2))
    return chosen


def _at(values: torch.Tensor, index: torch.Tensor) -> torch.Tensor:
    """Return rows [B, M, C] of `values` [B, N, C] at `index` [B, M]."""
    return values.gather(1, index.unsqueeze(2).expand(-1, -1, values.shape[2]))
