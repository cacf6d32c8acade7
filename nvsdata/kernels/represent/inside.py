"""Check that events are on their sensor."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def inside(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, width: int, height: int) -> bool:
    """Return whether columns are equally long, pixels are on a sensor of `width` x `height`, and polarities are 0 or 1.

    O(N). Kernels that index by pixel also raise an error at an invalid event, but only after processing those before
    it.
    """
    found: bool = _native.inside(t, x, y, p, width, height)
    return found
