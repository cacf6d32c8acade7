// The state of the decoder of DAVIS cameras between words, and the words of frames and inertial samples.
#pragma once

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <stdexcept>

#include "../decode/columns.h"
#include "../native/require.h"
#include "../native/span.h"

namespace nvsdata::davis {

// Counts of faults, by index; Python has the same names.
enum Fault {
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
    FAULTS
};

constexpr i64 VALUES = 14;      // bytes of the values of an inertial sample
constexpr i64 TEMPERATURE = 8;  // bit of the contents of a sample: its temperature was received
constexpr i64 MAX_SIDE = 0xFFFF;
constexpr i64 FAR = i64(1) << 60;  // no stream is long enough to reach it

struct Setting {
    i64 columns, rows;  // size for events
    i64 size[2];        // width and height of frames
    i64 swap, flip_x, flip_y;
    i64 factor;  // factor of the samples of frames
    i64 steady;  // whether times never decrease
};

// The place of the next pixel of a column, the step to the one after it, and the number of pixels that still fit.
struct Place {
    i64 at, step, room;
};

// Kept between calls in an int64 array. Python reads the first eight values.
struct State {
    i64 now;      // µs
    i64 left[2];  // first column and row of the current region
    i64 size[2];  // width and height of that region
    i64 frame_start, exposure_start, exposure_end;  // µs
    i64 base;                                       // µs up to the last wrap of the camera's clock
    i64 overflows;                                  // number of reported wraps of 2^31 µs
    i64 begun;                                      // whether a reset has been received
    i64 row;                                        // row of the next events
    i64 in_frame;
    i64 signal;              // whether signal columns are being read, rather than reset ones
    i64 columns[2], rows[2];  // reset and signal columns of this frame, and pixels in the current column
    Place next;
    i64 region[4], region_words;  // announced: first column, first row, last column, last row
    i64 high_byte;
    i64 in_sample;
    i64 count;   // number of bytes of its values so far
    i64 scaled;  // whether its scale word has been received
    i64 contents, acceleration_scale, rotation_scale;
    i64 sample_high;
    i64 sample[7];
};

static_assert(sizeof(State) == 41 * sizeof(i64) && sizeof(Setting) == 9 * sizeof(i64), "as many as in Python's arrays");

class Camera {
public:
    Setting how;
    State state;

    Camera(Span<const i64> setting, Span<const i64> kept, Span<i64> faults)
        : how(load<Setting>(setting)), state(load<State>(kept)), faults_(faults) {
        require(faults.size() == FAULTS, "the faults of another decoder");
    }

    // Whether no value exceeds an array or overflows; those of a decoder never do.
    bool is_sound(Span<const i64> kept, i64 pixels) const {
        auto up_to = [](i64 most, auto... values) { return ((u64(values) <= u64(most)) && ...); };
        auto is_near = [](i64 value) { return -FAR <= value && value <= FAR; };
        if (!std::all_of(kept.begin(), kept.end(), is_near)) return false;
        if (!up_to(MAX_SIDE, how.size[0], how.size[1], how.factor, state.size[0], state.size[1])) return false;
        if (how.size[0] * how.size[1] != pixels || std::abs(state.next.step) > MAX_SIDE) return false;
        return up_to(1, state.signal) && up_to(0xFF, state.high_byte, state.sample_high) &&
               up_to(FAR, state.columns[0], state.columns[1], state.rows[0], state.rows[1], state.region_words,
                     state.count);
    }

    void fault(Fault kind, i64 times = 1) { faults_[kind] += times; }

    void begin_frame(i64 now) {
        state.signal = 0;
        for (int kind = 0; kind < 2; ++kind) state.columns[kind] = state.rows[kind] = 0;
        state.region_words = 0;
        state.frame_start = now;
    }

    void begin_column(i64 signal) {
        state.signal = signal;
        state.rows[signal] = 0;
    }

    void end_column() {
        fault(SHORT_COLUMNS, state.rows[state.signal] < state.size[how.swap ? 0 : 1]);
        ++state.columns[state.signal];
    }

    // Whether the frame that ends here has all its columns, and its region was announced completely.
    bool end_frame() {
        i64 columns = state.size[how.swap ? 1 : 0];
        bool whole = state.columns[0] == columns && state.columns[1] == columns && columns > 0;
        if (whole && state.region_words % 4 == 0) return true;
        fault(BROKEN_FRAMES);
        return false;
    }

    // Count the pixels of a column that were read since `next` was taken from the state.
    void count_pixels(const Place& next) {
        state.rows[state.signal] += state.next.room - next.room;
        state.next = next;
    }

    // Set the place of the next pixel of the current column.
    void aim() {
        i64 wide = state.size[0], high = state.size[1];
        i64 columns = how.swap ? high : wide, rows = how.swap ? wide : high;
        i64 column = state.columns[state.signal], row = state.rows[state.signal];
        state.next = {0, 0, 0};
        if (column >= columns || row >= rows) return;
        i64 cx = how.flip_x ? columns - 1 - column : column, cy = how.flip_y ? rows - 1 - row : row;
        // a column of the device is a column of the image, or a row if swapped
        state.next.at = how.swap ? cx * wide + cy : cy * wide + cx;
        state.next.step = (how.flip_y ? -1 : 1) * (how.swap ? 1 : wide);
        state.next.room = rows - row;
    }

    // Process eight data bits of a region or of an inertial sample; return whether a new region is set.
    bool take_byte(i64 kind, i64 value) {
        if (kind == 1) {
            state.high_byte = value;
        } else if (kind == 2) {
            state.region[state.region_words++ % 4] = state.high_byte << 8 | value;
            if (state.region_words % 4 != 0) return false;
            for (int axis = 0; axis < 2; ++axis) {
                i64 side = how.size[axis], first = state.region[axis];
                i64 size = (state.region[2 + axis] + 1 - first) & 0xFFFF;
                if (size == 0 || size > side) size = side;
                state.left[axis] = first + size > side ? 0 : first;
                state.size[axis] = size;
            }
            return true;
        } else if (kind == 3) {
            if (state.in_sample) scale_sample(value);
        } else if (kind == 0) {
            if (state.in_sample) take_value(value);
        } else {
            fault(UNKNOWN_DATA);
        }
        return false;
    }

    void begin_sample() {
        state.in_sample = 1;
        state.count = state.scaled = state.contents = 0;
        std::fill(std::begin(state.sample), std::end(state.sample), 0);
    }

    // Whether the sample that ends here is complete.
    bool end_sample() {
        bool whole = state.in_sample && state.count == VALUES && state.scaled;
        fault(BROKEN_SAMPLES, !whole);
        // a second end word has no effect, and neither has a missing start word
        state.scaled = 0;
        return whole;
    }

private:
    Span<i64> faults_;

    void scale_sample(i64 value) {
        state.rotation_scale = value & 3;
        state.acceleration_scale = value >> 2 & 3;
        state.contents = value >> 5 | (state.contents & TEMPERATURE);
        state.scaled = 1;
        // acceleration, temperature, rotation: missing ones are skipped
        state.count = value & 0x80 ? 0 : value & 0x20 ? 6 : value & 0x40 ? 8 : VALUES;
    }

    // A byte of acceleration (slots 0 to 2), temperature (3) or rotation (4 to 6), the higher one first.
    void take_value(i64 value) {
        if (state.count >= VALUES) {
            fault(UNKNOWN_DATA);
        } else if (state.count % 2 == 0) {
            state.sample_high = value;
        } else {
            i64 slot = state.count / 2;
            state.sample[slot] = i16(state.sample_high << 8 | value);
            if (slot == 3) state.contents |= TEMPERATURE;
            i64 with_temperature = state.contents & 1, with_rotation = state.contents & 2;
            if (slot == 2 && !with_temperature)
                state.count += with_rotation ? 2 : 8;
            else if (slot == 3 && !with_rotation)
                state.count += 6;
        }
        ++state.count;
    }
};

}  // namespace nvsdata::davis
