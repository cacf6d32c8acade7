"""Pixels behind a photoreceptor of first order, whose bandwidth rises with the light: see `nvsdata.emulation.DVS`.

Light is a line from frame to frame, in steps of which each pixel has a rate of its own. Within a step a pixel is at
q(t) = base + slope t - lag exp(-rate t) above its memory, which turns once at most: so crossings are found on the
curve itself, and a tile whose light stays sleeps until one of its pixels reaches a threshold. Exponentials and
logarithms are the C library's, so the last bit of a level may depend on its version and on the processor.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.emulate.crossings import Array, Sensor


def rate(level: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Rate at which photoreceptors approach levels of light, in 1/µs: v2e's (I + 20) / 275 of that at white."""
    out = np.empty(level.shape, np.float64)
    _native.receptor_rates(level.astype(np.float64).reshape(-1), sensor.dark, sensor.speed, out.reshape(-1))
    return out


def advance_receptors(
    frame: np.ndarray,
    previous: np.ndarray,
    first_weight: int,
    given: np.ndarray,
    sensor: Sensor,
    array: Array,
    before: int,
    now: int,
    keys: np.ndarray,
) -> tuple[np.ndarray, int]:
    """Process a frame like `crossings.advance` where pixels have photoreceptors; all arrays are float64."""
    fixed = sensor.table, sensor.dark, sensor.thresholds, sensor.each.reshape(-1), sensor.leak, sensor.speed
    light = frame, previous, first_weight, given
    count, longer = _native.advance_receptors(*light, *fixed, *array, before, now, keys)
    return keys if longer is None else longer, count
