"""The logarithm of (3.1) in float32."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def logarithm(thousandths: np.ndarray, t_log: float, slope: float, out: np.ndarray) -> None:
    """Write ln q where q > t_log, else slope q, of brightness q in thousandths, (3.1), to `out`; off by at most 4e-7.

    `thousandths` is int32 or float32, `out` float32. The result is the same on every machine.
    """
    _native.logarithm(thousandths, t_log, slope, out)
