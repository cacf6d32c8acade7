"""The byte stream of DAVIS cameras (logic 18), word by word."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

# the state between chunks: an int64 array, by index
(
    OVERFLOW,  # times that 2^31 µs have passed
    BASE,  # µs, a multiple of 32768 below 2^31
    NOW,  # µs
    ROW,
    IN_FRAME,
    SIGNAL,  # whether signal columns are being read, rather than reset ones
    RESET_COLUMNS,
    SIGNAL_COLUMNS,
    RESET_ROWS,
    SIGNAL_ROWS,
    REGION_WORDS,
    HIGH_BYTE,
    REGION_0,  # announced: first column, first row, last column, last row
    REGION_1,
    REGION_2,
    REGION_3,
    LEFT,  # in force
    TOP,
    SIZE_X,
    SIZE_Y,
    FRAME_START,  # µs, with overflow
    EXPOSURE_START,
    EXPOSURE_END,
    IN_SAMPLE,
    SAMPLE_COUNT,
    SAMPLE_SCALED,  # whether the sample's scale word has been received
    CONTENTS,
    ACCELERATION_SCALE,
    ROTATION_SCALE,
    SAMPLE_HIGH,
    AT,  # index of the next pixel, step to the one after it, and how many more the column can hold
    STEP,
    ROOM,
    BEGUN,  # whether a reset has been received
    SAMPLE_0,  # seven values
    STATES,
) = [*range(35), 41]

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

WRAP_LENGTH = 1 << 15  # µs that the camera's clock counts between wraps

# special events, by the vendor's numbers
WRAP, RESET, RISING, FALLING, PULSE, GENERATOR_RISING, GENERATOR_FALLING = 0, 1, 2, 3, 4, 12, 13
FRAME_START_EVENT, FRAME_END_EVENT, EXPOSURE_START_EVENT, EXPOSURE_END_EVENT = 14, 15, 16, 17

DARK = 384  # a reset sample below it was cut off by the light
WHITE = 1023


@njit
def decode(words, start, state, error_counts, setting, pixels, t, x, y, p, specials, samples):
    """Decode words from `start` on, until they end, a frame is complete or an output is full. O(words).

    - `words` uint16 [N]
    - `setting` int64: columns and rows of events, 0; width, height, swap, flip x, flip y of frames, factor of their
      samples; and whether times never fall. If so, a time that would fall is taken as a sign of a lost wrap, and resets
      after the first are ignored
    - `state`, `error_counts`, `pixels` (uint16 [width * height]): kept between calls
    - outputs: `t` int64, `x`, `y` int16 (the device's column and row), `p` uint8 [at least N]; `specials` int64 [M, 4]:
      word, µs, type, events before it; `samples` int64 [M, 12]: word, µs, contents, scales of acceleration and
      rotation, seven values

    Returns the word it stopped at, the numbers of events, specials and samples, and whether a frame ended there.
    """
    columns, rows = setting[0], setting[1]
    factor, steady = setting[8], setting[9]
    base = (state[OVERFLOW] << 31) + state[BASE]
    now = (state[OVERFLOW] << 31) + state[NOW]
    row = state[ROW]
    in_frame = state[IN_FRAME]
    n_specials = n_samples = 0
    # unsigned, so that numba doesn't look for negative ones
    i, events, one = np.uint64(start), np.uint64(0), np.uint64(1)
    size = np.uint64(words.size)
    at, step, room, signal = state[AT], state[STEP], state[ROOM], state[SIGNAL]
    frame = False
    falls = 0
    while i < size:
        word = np.int64(words[i])
        if word >= 0x8000:
            before = now
            now = base + (word & 0x7FFF)
            if now <= before:
                falls += 1
                if steady and now < before:
                    wraps = (before - now + WRAP_LENGTH - 1) // WRAP_LENGTH
                    error_counts[LOST_WRAPS] += wraps
                    base += wraps * WRAP_LENGTH
                    now += wraps * WRAP_LENGTH
            i += one
            continue
        data = word & 0xFFF
        if 0x2000 <= word < 0x4000:
            if data < columns:
                t[events] = now
                x[events] = data
                y[events] = row
                p[events] = word >> 12 & 1
                events += one
            else:
                error_counts[COLUMN_OUT_OF_RANGE] += 1
            i += one
            continue
        code = word >> 12
        if code == 1:
            if data < rows:
                row = data
            else:
                error_counts[ROW_OUT_OF_RANGE] += 1
        elif code == 4:
            # samples come in columns, interrupted by events
            if in_frame:
                if room > 0:
                    value = data * factor
                    if signal:
                        reset = np.int64(pixels[np.uint64(at)])
                        light = WHITE if reset < DARK or value == 0 else min(max(reset - value, 0), WHITE)
                        value = light << 6
                    pixels[np.uint64(at)] = value
                    at += step
                    room -= 1
                else:
                    error_counts[SURPLUS_PIXELS] += 1
        elif code == 7:
            if n_specials == specials.shape[0]:
                break
            base += data << 15
            now = max(base, now) if steady else base
            if (base >> 31) != state[OVERFLOW]:
                # at most one overflow: a word holds up to 4,095 wraps, and 2^31 µs are 65,536
                state[OVERFLOW] += 1
                n_specials = _note(specials, n_specials, np.int64(i), now, WRAP, np.int64(events))
                in_frame = state[IN_SAMPLE] = 0
        elif code == 0:
            if n_specials == specials.shape[0] or n_samples == samples.shape[0]:
                break
            kind = -1
            if 8 <= data <= 13:
                # a column begins or ends: check the pixels so far
                state[RESET_ROWS + signal] += state[ROOM] - room
                state[ROOM] = room
            if data == 1 and steady and state[BEGUN]:
                error_counts[LATE_RESETS] += 1
            elif data == 1:
                state[BEGUN] = 1
                state[OVERFLOW] = base = now = 0
                in_frame = state[IN_SAMPLE] = 0
                kind = RESET
            elif data == 8 or data == 9:
                in_frame = 1
                state[SIGNAL] = state[RESET_COLUMNS] = state[SIGNAL_COLUMNS] = 0
                state[RESET_ROWS] = state[SIGNAL_ROWS] = state[REGION_WORDS] = 0
                state[FRAME_START] = now
                kind = FRAME_START_EVENT
            elif 10 <= data <= 15:
                if in_frame:
                    if data == 10:
                        kind = FRAME_END_EVENT
                        frame = _complete(state, error_counts, setting)
                    elif data == 11 or data == 12:
                        state[SIGNAL] = data - 11
                        state[RESET_ROWS + data - 11] = 0
                    elif data == 13:
                        high = state[SIZE_X if setting[5] else SIZE_Y]
                        error_counts[SHORT_COLUMNS] += state[RESET_ROWS + state[SIGNAL]] < high
                        state[RESET_COLUMNS + state[SIGNAL]] += 1
                    elif data == 14:
                        state[EXPOSURE_START] = now
                        kind = EXPOSURE_START_EVENT
                    else:
                        state[EXPOSURE_END] = now
                        kind = EXPOSURE_END_EVENT
            elif data == 2 or data == 3:
                kind = FALLING if data == 2 else RISING
            elif data == 4:
                kind = PULSE
            elif data == 16 or data == 17:
                kind = GENERATOR_FALLING if data == 16 else GENERATOR_RISING
            elif data == 5:
                state[IN_SAMPLE] = 1
                state[SAMPLE_COUNT] = state[SAMPLE_SCALED] = state[CONTENTS] = 0
                state[SAMPLE_0 : SAMPLE_0 + 7] = 0
            elif data == 7:
                if state[IN_SAMPLE] and state[SAMPLE_COUNT] == 14 and state[SAMPLE_SCALED]:
                    samples[n_samples, 0] = np.int64(i)
                    samples[n_samples, 1] = now
                    samples[n_samples, 2] = state[CONTENTS]
                    samples[n_samples, 3] = state[ACCELERATION_SCALE]
                    samples[n_samples, 4] = state[ROTATION_SCALE]
                    for j in range(7):
                        samples[n_samples, 5 + j] = state[SAMPLE_0 + j]
                    n_samples += 1
                else:
                    error_counts[BROKEN_SAMPLES] += 1
                # a second end word finds nothing new; a lost start word does no harm
                state[SAMPLE_SCALED] = 0
            else:
                error_counts[UNKNOWN_SPECIAL] += 1
            if 8 <= data <= 13:
                _aim(state, setting)
                at, step, room, signal = state[AT], state[STEP], state[ROOM], state[SIGNAL]
            if kind >= 0:
                n_specials = _note(specials, n_specials, np.int64(i), now, kind, np.int64(events))
            if frame:
                i += one
                break
        elif code == 5:
            if _byte(data >> 8, data & 0xFF, state, error_counts, setting):
                state[RESET_ROWS + signal] += state[ROOM] - room
                _aim(state, setting)
                at, step, room = state[AT], state[STEP], state[ROOM]
        elif data >> 10:
            error_counts[UNKNOWN_DATA] += 1
        i += one
    error_counts[TIME_NOT_RISING] += falls
    state[RESET_ROWS + signal] += state[ROOM] - room
    state[AT], state[ROOM] = at, room
    state[OVERFLOW] = base >> 31
    state[BASE] = base & 0x7FFFFFFF
    state[NOW] = now - (state[OVERFLOW] << 31)
    state[ROW] = row
    state[IN_FRAME] = in_frame
    return np.int64(i), np.int64(events), n_specials, n_samples, frame


@njit
def _note(specials, n, word, now, kind, events):
    """Store a special event; returns the new number of them."""
    specials[n, 0] = word
    specials[n, 1] = now
    specials[n, 2] = kind
    specials[n, 3] = events
    return n + 1


@njit
def _aim(state, setting):
    """Set where the next pixel of the current column goes."""
    signal = state[SIGNAL]
    wide, high = state[SIZE_X], state[SIZE_Y]
    swap, flip_x, flip_y = setting[5], setting[6], setting[7]
    columns, rows = (high, wide) if swap else (wide, high)
    column, row = state[RESET_COLUMNS + signal], state[RESET_ROWS + signal]
    cx = columns - 1 - column if flip_x else column
    cy = rows - 1 - row if flip_y else row
    # a column of the device goes down the picture, or to the right if swapped
    state[AT] = cx * wide + cy if swap else cy * wide + cx
    state[STEP] = (-1 if flip_y else 1) * (1 if swap else wide)
    state[ROOM] = max(rows - row, 0) if column < columns else 0


@njit
def _complete(state, error_counts, setting):
    """Whether the frame that ends here has all its columns, and its region was announced completely."""
    columns = state[SIZE_Y if setting[5] else SIZE_X]
    whole = state[RESET_COLUMNS] == columns and state[SIGNAL_COLUMNS] == columns
    if whole and columns > 0 and state[REGION_WORDS] % 4 == 0:
        return True
    error_counts[BROKEN_FRAMES] += 1
    return False


@njit
def _byte(kind, value, state, error_counts, setting):
    """Process eight data bits of a region or of an inertial sample; returns whether a new region came into force."""
    if kind == 1:
        state[HIGH_BYTE] = value
    elif kind == 2:
        state[REGION_0 + state[REGION_WORDS] % 4] = state[HIGH_BYTE] << 8 | value
        state[REGION_WORDS] += 1
        if state[REGION_WORDS] % 4 == 0:
            for axis in range(2):
                side = setting[3 + axis]
                first = state[REGION_0 + axis]
                size = (state[REGION_2 + axis] + 1 - first) & 0xFFFF
                if size == 0 or size > side:
                    size = side
                if first + size > side:
                    first = 0
                state[LEFT + axis] = first
                state[SIZE_X + axis] = size
            return True
    elif kind == 3:
        if state[IN_SAMPLE]:
            state[ROTATION_SCALE] = value & 3
            state[ACCELERATION_SCALE] = value >> 2 & 3
            state[CONTENTS] = value >> 5 | (state[CONTENTS] & 8)
            state[SAMPLE_SCALED] = 1
            # acceleration, temperature, rotation: missing ones are skipped
            state[SAMPLE_COUNT] = 0 if value & 0x80 else 6 if value & 0x20 else 8 if value & 0x40 else 14
    elif kind == 0:
        if state[IN_SAMPLE]:
            count = state[SAMPLE_COUNT]
            if count >= 14:
                error_counts[UNKNOWN_DATA] += 1
            elif count % 2 == 0:
                state[SAMPLE_HIGH] = value
            else:
                slot = count // 2
                number = state[SAMPLE_HIGH] << 8 | value
                state[SAMPLE_0 + slot] = number - 65536 if number > 32767 else number
                if slot == 3:
                    state[CONTENTS] |= 8  # the temperature has been received
                with_temperature, with_rotation = state[CONTENTS] & 1, state[CONTENTS] & 2
                if slot == 2 and not with_temperature:
                    count += 2 if with_rotation else 8
                elif slot == 3 and not with_rotation:
                    count += 6
            state[SAMPLE_COUNT] = count + 1
    else:
        error_counts[UNKNOWN_DATA] += 1
    return False


@njit
def measure(rows, flips, slope, zero, acceleration, rotation, temperature):
    """Samples of `decode` (int64 [N, 12]) in physical units: g and degrees/s, float32 [N, 3]; °C, float32 [N]. O(N).

    `flips`: axes that are negated (4: x, 2: y, 1: z); `slope` and `zero` of the temperature, float32.
    """
    for n in range(rows.shape[0]):
        per_g = np.float32(65536 / (4 << rows[n, 3]))
        per_degree = np.float32(65536 / (500 << rows[n, 4]))
        for axis in range(3):
            sign = -1 if flips >> (2 - axis) & 1 else 1
            # 16 bits have no +32768
            a, r = rows[n, 5 + axis], rows[n, 9 + axis]
            acceleration[n, axis] = np.float32(a if a == -32768 else sign * a) / per_g
            rotation[n, axis] = np.float32(r if r == -32768 else sign * r) / per_degree
        known = rows[n, 2] & 8
        temperature[n] = np.float32(rows[n, 8]) / slope + zero if known else np.float32(0)
