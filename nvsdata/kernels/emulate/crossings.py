"""Pixels that compare their level with that at their last event, frame by frame: see `nvsdata.emulation.DVS`.

Arrays: `level`, `memory`, `reached`, `speed` of one float type [H, W], the last two only with a photoreceptor; frames
uint8 [H, W * C]. Between frames a level is a line, so a pixel crosses thresholds in one direction only, and where
neither light nor memory moves it doesn't cross any. So tiles that don't change are left out until their `wake`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.decode.clock import LATEST

NEVER = LATEST  # µs


class Sensor(NamedTuple):
    """Constants of a sensor, the same for all frames.

    - `table`: level by gray byte or by luminance in thousandths; empty to compute logarithms of colors
    - `dark`: thousandths of a gray level that are added to brightness before its logarithm
    - `thresholds` [2]: OFF and ON; `each` [2, H, W]: thresholds of single pixels, or empty
    - `leak`: by how much memory falls per µs
    - `speed`: rate of a white pixel's photoreceptor in 1/µs; 0 for one without delay
    """

    table: np.ndarray
    dark: int
    thresholds: np.ndarray
    each: np.ndarray
    leak: float
    speed: float


class Array(NamedTuple):
    """The state of all pixels, and of tiles [tile rows, tile columns].

    - `level`: logarithm of the light in the last frame
    - `memory`: level at the last event, as if it had been at time 0
    - `reached`: where photoreceptors were when their tile changed last, and `speed`: how fast they approach the level
    - `dirty` bool: tiles that changed; `wake` int64: when (µs) one may fire though it doesn't change
    - `since` int64: µs of its last change
    """

    level: np.ndarray
    memory: np.ndarray
    reached: np.ndarray
    speed: np.ndarray
    dirty: np.ndarray
    wake: np.ndarray
    since: np.ndarray


def advance(
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
    """Process a frame at `now` µs, the last one was at `before`; return the keys of its events and their number.

    `given` [H, W] replaces the logarithm of the frame's bytes, unless it is empty. Keys are written to `keys` or, if it
    is too short, to a longer array. O(bytes + active pixels + events).
    """
    fixed = sensor.table, sensor.dark, sensor.thresholds, sensor.each.reshape(-1), sensor.leak
    state = array.level, array.memory, array.dirty, array.wake
    count, longer = _native.advance(frame, previous, first_weight, given, *fixed, *state, before, now, keys)
    return keys if longer is None else longer, count


def receptor_rates(level: np.ndarray, sensor: Sensor) -> np.ndarray:
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
    """Process a frame like `advance` where pixels have photoreceptors (photoreceptor.cpp); all arrays are float64.

    Light is a line from frame to frame, in steps of which each pixel has a rate of its own. Within a step a pixel is at
    q(t) = base + slope t - lag exp(-rate t) above its memory, which turns once at most: so crossings are found on the
    curve itself, and a tile whose light stays sleeps until one of its pixels reaches a threshold. Exponentials and
    logarithms are the C library's, so the last bit of a level may depend on its version and on the processor.
    """
    fixed = sensor.table, sensor.dark, sensor.thresholds, sensor.each.reshape(-1), sensor.leak, sensor.speed
    light = frame, previous, first_weight, given
    count, longer = _native.advance_receptors(*light, *fixed, *array, before, now, keys)
    return keys if longer is None else longer, count
