"""Pixels that compare their level with that at their last event, frame by frame: see `nvsdata.emulation.DVS`.

The arrays `level`, `memory`, `reached` and `speed` are [H, W] of one float type; the last two are used only with a
photoreceptor. Frames are uint8 [H, W * C]. Between frames a level changes linearly, so a pixel crosses thresholds in
one direction only. It crosses none if neither the light nor its memory changes. So tiles that don't change are skipped
until their time `wake`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.decode.clock import LATEST

NEVER = LATEST  # µs


class Sensor(NamedTuple):
    """Constants of a sensor, the same for all frames.

    - `table`: level (logarithm of brightness) of each gray byte, or of each luminance in thousandths; empty if the
      logarithms of color frames are computed for every frame
    - `dark`: brightness that is added before the logarithm, in thousandths of a gray level
    - `thresholds` [2]: thresholds of OFF and ON; `each` [2, H, W]: thresholds of single pixels, or empty
    - `leak`: decrease per µs of a pixel's memory, its level at the last event
    - `speed`: rate of the photoreceptor of a white pixel in 1/µs; 0 for a photoreceptor without delay
    """

    table: np.ndarray
    dark: int
    thresholds: np.ndarray
    each: np.ndarray
    leak: float
    speed: float


class Array(NamedTuple):
    """The state of all pixels, and of tiles [tile rows, tile columns].

    - `level`: logarithm of the light in the latest frame
    - `memory`: level at the last event, with the leak since time 0 added back
    - `reached`: levels of the photoreceptors at the last change of their tile; `speed`: their rates in 1/µs
    - `dirty` bool: tiles that changed; `wake` int64: time in µs from which a tile may fire without a change
    - `since` int64: time in µs of the last change of a tile
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
    """Process a frame at `now` µs after one at `before` µs; return the keys of its events and their number.

    `given` [H, W] replaces the logarithm of the frame's bytes, unless it is empty. Keys are written to `keys` or, if
    that is too short, to a longer array. O(bytes + active pixels + events).
    """
    fixed = sensor.table, sensor.dark, sensor.thresholds, sensor.each.reshape(-1), sensor.leak
    state = array.level, array.memory, array.dirty, array.wake
    count, longer = _native.advance(frame, previous, first_weight, given, *fixed, *state, before, now, keys)
    return keys if longer is None else longer, count


def receptor_rates(level: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return the rates, in 1/µs, at which photoreceptors approach their levels of light.

    As in v2e, the rate at gray level I is (I + 20) / 275 times that of a white pixel.
    """
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
    """Process a frame like `advance` for pixels with photoreceptors (photoreceptor.cpp); all arrays are float64.

    Light changes linearly from frame to frame. The time between two frames is divided into steps, within which the rate
    of each photoreceptor (see `receptor_rates`) is constant. Within a step, the level of a pixel exceeds its memory by
    q(t) = base + slope t - lag exp(-rate t). This curve has at most one turning point, so crossings are found exactly.
    A tile whose light is constant is skipped until one of its pixels reaches a threshold. Exponentials and logarithms
    are computed by the C library, so the last bit of a level may depend on its version and on the processor.
    """
    fixed = sensor.table, sensor.dark, sensor.thresholds, sensor.each.reshape(-1), sensor.leak, sensor.speed
    light = frame, previous, first_weight, given
    count, longer = _native.advance_receptors(*light, *fixed, *array, before, now, keys)
    return keys if longer is None else longer, count
