"""Conversion of events of AEDAT 4 to columns."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def aedat4_decode(
    words: np.ndarray,
    latest: int,
    width: int,
    height: int,
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> bool:
    """Write the columns of N events of two int64 words each; return True if all are valid. O(N).

    The first word of an event is its time. The second one has x, y and polarity in 16 bits each, of which polarity uses
    8. An event is valid if its time is between -`latest` and `latest` (both excluded), its pixel is on the sensor, and
    its polarity is 0 or 1.
    """
    valid: bool = _native.aedat4_decode(words, latest, width, height, t, x, y, p)
    return valid
