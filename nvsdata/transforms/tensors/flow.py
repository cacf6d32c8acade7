"""Optical flow of each event (Benosman et al. 2014)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import microseconds, positive, whole
from nvsdata.data.events import LATEST, Events
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent import flow as kernel
from nvsdata.kernels.represent.filters import NEVER

LARGEST = 8  # pixels from an event to the border of its neighborhood


@dataclass(frozen=True)
class PlaneFlow:
    """Compute the velocity of the edge at each event from a plane fit (Benosman et al. 2014).

    An edge that moves evenly leaves a plane in space and time. The plane is fitted by least squares to the last events
    of the pixels around event i, of its polarity and not older than `window`. Events whose times differ from the plane
    by more than `tolerance` are left out and the fit is repeated, until there are none. The velocity is g / |g|², where
    g is the plane's gradient (time per pixel). This is the velocity perpendicular to the edge.

    An event is valid if `least` events remain that aren't on one line, event i is within `tolerance` of the plane, and
    the speed is at most a pixel per µs. Apply `RefractoryPeriod` first if an edge causes several events at a pixel,
    because the first one has the time of the edge.

    Args:
        radius: Distance in pixels from an event to the border of its square neighborhood, at most 8 (default 2).
        window: Maximum age in µs of the events that are used (default 50,000).
        tolerance: Maximum difference in µs between an event and the plane (default 2000).
        least: Minimum number of events of a plane, at least 3 (default 6).

    Returns:
        float32 [N, 3] for N events: the velocity along x and y in pixels per second, and 1 if it is valid. All three
        are 0 if it isn't. The call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> x, y = [0, 0, 0, 1, 1, 1, 2, 2, 2], [0, 1, 2] * 3
        >>> edge = Events([0] * 3 + [1000] * 3 + [2000] * 3, x, y, [1] * 9, (3, 3))  # 1 ms per pixel, to the right
        >>> T.PlaneFlow()(edge)[-1].tolist()
        [1000.0, 0.0, 1.0]
    """

    radius: int = 2
    window: int = 50_000
    tolerance: float = 2_000
    least: int = 6
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("radius", self.radius, 1)
        if self.radius > LARGEST:
            raise ValueError(f"radius must be at most {LARGEST} pixels, not {self.radius}")
        microseconds("window", self.window)
        positive("tolerance", self.tolerance)
        whole("least", self.least, 3)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events, radius = events_inside(sample), int(self.radius)
        width, height = events.sensor_size
        latest = zeros(events.sensor_size, (2, height + 2 * radius, width + 2 * radius), np.int64, NEVER)
        settings = radius, min(int(self.window), LATEST), float(self.tolerance), min(int(self.least), 2**62)
        return torch.from_numpy(kernel.plane_flow(*events.columns, *settings, latest))
