"""Rectangles around objects, which move with the events of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch


@dataclass(frozen=True, eq=False)
class Boxes:
    """N boxes on a sensor, cut at its edges; those of which nothing is left are dropped.

    - `edges` float32 [N, 4]: left, top, right and bottom edge in pixels; the pixel 0 lies between the edges 0 and 1
    - `sensor_size`: (width, height) in pixels
    - `index` int64 [N]: which of the original boxes each is
    """

    edges: torch.Tensor
    sensor_size: tuple[int, int]
    index: torch.Tensor

    @classmethod
    def of(cls, edges: Any, sensor_size: tuple[int, int]) -> Boxes:
        """Boxes with these edges, a tensor, array or list; ValueError unless they are [N, 4], right and bottom last."""
        edges = torch.as_tensor(edges, dtype=torch.float32, device="cpu")
        edges = edges.reshape(-1, 4) if edges.numel() == 0 else edges
        if edges.ndim != 2 or edges.shape[1] != 4 or not bool((edges[:, :2] <= edges[:, 2:]).all()):
            raise ValueError(f"boxes must be [N, 4] of left, top, right and bottom edges, not {edges.tolist()}")
        return cls(edges, sensor_size, torch.arange(len(edges)))._cut(edges, sensor_size)

    def equal(self, other: Boxes) -> bool:
        """Whether these are the same boxes at the same places of the same sensor."""
        same = self.sensor_size == other.sensor_size and torch.equal(self.index, other.index)
        return same and torch.equal(self.edges, other.edges)

    @property
    def pos(self) -> torch.Tensor:
        """The corners as `Graph.pos` counts, where a pixel's center is its coordinate: float32 [4 N, 2]."""
        return self.edges[:, [0, 1, 2, 1, 0, 3, 2, 3]].reshape(-1, 2) - 0.5

    def moved(self, pos: torch.Tensor) -> Boxes:
        """The boxes around the corners `pos`, which are counted as in `pos`."""
        corners = (pos + 0.5).reshape(-1, 4, 2)
        return self._cut(torch.cat((corners.amin(1), corners.amax(1)), 1), self.sensor_size)

    def seen(self, x: float, y: float, scale: tuple[float, float], sensor_size: tuple[int, int]) -> Boxes:
        """The boxes on a sensor whose edge 0 lies at (x, y), and whose pixels are 1 / scale as wide and high."""
        edges = (self.edges - torch.tensor([x, y, x, y])) * torch.tensor([*scale, *scale])
        return self._cut(edges, sensor_size)

    def _cut(self, edges: torch.Tensor, sensor_size: tuple[int, int]) -> Boxes:
        inside = edges.clamp_min(0).minimum(torch.tensor([*sensor_size, *sensor_size]))
        left = (inside[:, 2:] > inside[:, :2]).all(1)
        return Boxes(inside[left], sensor_size, self.index[left])
