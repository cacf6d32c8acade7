"""Corner events (Mueggler et al. 2017)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nvsdata.common.memory import zeros
from nvsdata.kernels.represent import corners as kernel
from nvsdata.kernels.represent.filters import NEVER
from nvsdata.transforms.events.causal_filters import CausalFilter


@dataclass(frozen=True)
class Corners(CausalFilter):
    """Keep the events at corners of moving edges: eFAST (Mueggler et al. 2017).

    The filter has the time of each pixel's last event, for each polarity separately. An event is a corner if an arc of
    3 to 6 neighboring pixels, of the 16 on a circle of radius 3 around it, is newer than the rest of the circle, and an
    arc of 4 to 8 of the 20 pixels on a circle of radius 4, too. Events less than 4 pixels from the sensor's border are
    dropped.

    A corner at the rear of a shape is missed if its pixels have one event each, because most of the circle is new.
    Noise causes wrong corners: apply `BackgroundActivity` first.

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them; for streams, see `begin`.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> T.Corners()(nvsdata.example())
        Events(1433 events, 486940 µs, 240x180)
    """

    def _masks(self, width: int, height: int) -> Callable[..., np.ndarray]:
        latest = zeros((width, height), (2, height, width), np.int64, NEVER)
        return lambda t, x, y, p: kernel.corners(t, x, y, p, latest)
