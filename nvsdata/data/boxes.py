"""Bounding boxes of objects, which transforms change along with the events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch


@dataclass(frozen=True, eq=False)
class Boxes:
    """N boxes on a sensor, clipped to it. Boxes outside the sensor are dropped.

    Args:
        edges: float32 [N, 4], left, top, right and bottom edge in pixels; pixel 0 is between the edges 0 and 1.
        sensor_size: (width, height) in pixels.
        index: int64 [N], index of each box among those from which this object was made, before any were dropped.
    """

    edges: torch.Tensor
    sensor_size: tuple[int, int]
    index: torch.Tensor

    @classmethod
    def of(cls, edges: Any, sensor_size: tuple[int, int]) -> Boxes:
        """Return boxes with these `edges`, clipped to the sensor.

        ValueError unless `edges` is [N, 4] with left <= right and top <= bottom edges, in the order of the field.
        """
        edges = torch.as_tensor(edges, dtype=torch.float32, device="cpu")
        edges = edges.reshape(-1, 4) if edges.numel() == 0 else edges
        if edges.ndim != 2 or edges.shape[1] != 4 or not bool((edges[:, :2] <= edges[:, 2:]).all()):
            raise ValueError(f"boxes must be [N, 4] of left, top, right and bottom edges, not {edges.tolist()}")
        return cls(edges, sensor_size, torch.arange(len(edges)))._cut(edges, sensor_size)

    def equal(self, other: Boxes) -> bool:
        """Return whether these are the same boxes at the same positions of the same sensor."""
        same = self.sensor_size == other.sensor_size and torch.equal(self.index, other.index)
        return same and torch.equal(self.edges, other.edges)

    @property
    def pos(self) -> torch.Tensor:
        """The corners, float32 [4 N, 2], in the coordinates of `Graph.pos`, where integers are centers of pixels."""
        return self.edges[:, [0, 1, 2, 1, 0, 3, 2, 3]].reshape(-1, 2) - 0.5

    def moved(self, pos: torch.Tensor) -> Boxes:
        """Return the boxes around moved corners [4 N, 2], in the order and coordinates of the property `pos`."""
        corners = (pos + 0.5).reshape(-1, 4, 2)
        return self._cut(torch.cat((corners.amin(1), corners.amax(1)), 1), self.sensor_size)

    def seen(self, x: float, y: float, scale: tuple[float, float], sensor_size: tuple[int, int]) -> Boxes:
        """Return the boxes in the coordinates of another sensor of `sensor_size`.

        The other sensor's top left corner is at (x, y), in pixels of this sensor. Its pixels are 1 / scale as wide and
        high as those of this sensor.
        """
        edges = (self.edges - torch.tensor([x, y, x, y])) * torch.tensor([*scale, *scale])
        return self._cut(edges, sensor_size)

    def _cut(self, edges: torch.Tensor, sensor_size: tuple[int, int]) -> Boxes:
        inside = edges.clamp_min(0).minimum(torch.tensor([*sensor_size, *sensor_size]))
        left = (inside[:, 2:] > inside[:, :2]).all(1)
        return Boxes(inside[left], sensor_size, self.index[left])
