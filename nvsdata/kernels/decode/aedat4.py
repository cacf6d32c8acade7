"""Events of AEDAT 4 to columns."""

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

    A word of time, then x, y and polarity in 16 bits each, of which polarity has only 8. Valid are times between
    -`latest` and `latest`, both excluded, places inside the sensor, and polarities 0 and 1.
    """
    valid: bool = _native.aedat4_decode(words, latest, width, height, t, x, y, p)
    return valid
