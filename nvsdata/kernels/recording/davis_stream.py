"""The byte stream of DAVIS cameras (logic version 18), word by word; and the words of simulated cameras."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

# indexes of the state between chunks, an int64 array, that Python reads; only `decode` uses the others
(
    NOW,  # µs
    LEFT,  # of the region of frames that is in force
    TOP,
    SIZE_X,
    SIZE_Y,
    FRAME_START,  # µs
    EXPOSURE_START,
    EXPOSURE_END,
) = range(8)
STATES = 41

# counts of faults, an int64 array, by index
(
    ROW_OUT_OF_RANGE,
    COLUMN_OUT_OF_RANGE,
    TIME_NOT_RISING,
    UNKNOWN_SPECIAL,
    UNKNOWN_DATA,
    SURPLUS_PIXELS,
    SHORT_COLUMNS,
    BROKEN_FRAMES,
    BROKEN_SAMPLES,
    LOST_WRAPS,
    LATE_RESETS,
    ERRORS,
) = range(12)

# special events, by the vendor's numbers
WRAP, RESET, RISING, FALLING, PULSE, GENERATOR_RISING, GENERATOR_FALLING = 0, 1, 2, 3, 4, 12, 13
FRAME_START_EVENT, FRAME_END_EVENT, EXPOSURE_START_EVENT, EXPOSURE_END_EVENT = 14, 15, 16, 17


def decode(
    words: np.ndarray,
    start: int,
    state: np.ndarray,
    error_counts: np.ndarray,
    setting: np.ndarray,
    pixels: np.ndarray,
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    specials: np.ndarray,
    samples: np.ndarray,
) -> tuple[int, int, int, int, bool]:
    """Decode words from `start` on, until they end, a frame is complete or an output is full. O(words).

    Args:
        words: Words of the stream, uint16 [N].
        start: Index of the first word.
        state: State of the decoder, int64 [STATES]. It keeps its contents between calls, like `error_counts` and
            `pixels`, and must be zero before the first call.
        error_counts: Numbers of faults, int64 [ERRORS].
        setting: int64 [9]: columns and rows of events; width, height, swap, flip x and flip y of frames; factor of
            their samples; and 1 if times never decrease. In this case a decrease means that a wrap was lost, and
            resets after the first are ignored.
        pixels: Pixels of the frame, uint16 [width * height].
        t: Output for times in µs, int64. This and the next three outputs have at least N - start elements.
        x: Output for columns of the device, int16.
        y: Output for rows of the device, int16.
        p: Output for polarities, uint8.
        specials: Output for special events, int64 [M, 4]: word, time in µs, type, number of events before it.
        samples: Output for inertial samples, int64 [M, 12]: word, time in µs, contents, scales of acceleration and
            rotation, seven values.

    Returns:
        Index of the next word, numbers of events, special events and samples, and whether a frame ended there.
    """
    found: tuple[int, int, int, int, bool] = _native.davis_decode(
        words, start, state, error_counts, setting, pixels, t, x, y, p, specials, samples
    )
    return found


def measure(
    rows: np.ndarray,
    flips: int,
    slope: float,
    zero: float,
    acceleration: np.ndarray,
    rotation: np.ndarray,
    temperature: np.ndarray,
) -> None:
    """Convert samples of `decode` (int64 [N, 12]) to g and degrees/s, float32 [N, 3], and °C, float32 [N]. O(N).

    `flips` is the sum of the axes that are negated (4: x, 2: y, 1: z). `slope` and `zero` convert the temperature.
    """
    _native.davis_measure(rows, flips, slope, zero, acceleration, rotation, temperature)


def encode(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, state: np.ndarray, words: np.ndarray) -> int:
    """Encode events as the 16-bit words that a DAVIS sends. O(N).

    A time word is written only if the time changed, and a row word only if the time or the row changed. Then each event
    has a word with its column and polarity.

    Args:
        t: Times in µs, int64, which must not decrease.
        x: Columns, of any type; they are converted to int16.
        y: Rows, of any type; they are converted to int16.
        p: Polarities, of any type; they are converted to uint8.
        state: int64 [3]: µs of the wraps so far, and the last time and row that were sent, -1 for none.
        words: Output for the words, uint16, with 4 N elements and one per wrap.

    Returns:
        Number of words.
    """
    columns = np.asarray(x, np.int16), np.asarray(y, np.int16), np.asarray(p, np.uint8)
    count: int = _native.davis_encode(t, *columns, state, words)
    return count
