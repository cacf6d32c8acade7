// The byte stream of DAVIS cameras (logic version 18), word by word.
#include <algorithm>
#include <stdexcept>

#include "../native/bind.h"
#include "../decode/events.h"
#include "davis_stream.h"

namespace nvsdata {

namespace davis {

namespace {

constexpr u64 WRAP_LENGTH = 1 << 15;  // µs that the camera's clock counts between wraps
constexpr i64 MOST_WRAPS = 4095;      // largest number of wraps in a word
constexpr i64 SPECIAL_VALUES = 4, SAMPLE_VALUES = 12;

// special events, by the vendor's numbers; Python has the same names
enum Special {
    NONE = -1,
    WRAP = 0,
    RESET = 1,
    RISING = 2,
    FALLING = 3,
    PULSE = 4,
    GENERATOR_RISING = 12,
    GENERATOR_FALLING = 13,
    FRAME_START = 14,
    FRAME_END = 15,
    EXPOSURE_START = 16,
    EXPOSURE_END = 17,
};

constexpr i64 DARK = 384;  // a reset sample below it was saturated by the light
constexpr i64 WHITE = 1023;

u16 light(i64 reset, i64 value) {
    return u16((reset < DARK || value == 0 ? WHITE : std::clamp(reset - value, i64(0), WHITE)) << 6);
}

}  // namespace

std::tuple<i64, i64, i64, i64, bool> decode(Span<const u16> words, i64 start, Span<i64> kept, Span<i64> faults,
                                            Span<const i64> setting, Span<u16> pixels, Span<i64> t, Span<i16> x,
                                            Span<i16> y, Span<u8> p, Rows<i64> specials, Rows<i64> samples) {
    i64 size = words.size();
    require(specials.columns() == SPECIAL_VALUES && samples.columns() == SAMPLE_VALUES,
            "the outputs of another decoder");
    require(u64(start) <= u64(size) && std::min({t.size(), x.size(), y.size(), p.size()}) >= size - start,
            "the columns must have room for an event per word");
    Camera camera(setting, kept, faults);
    require(camera.is_sound(kept, pixels.size()), "a state or a setting that no decoder has");

    State& state = camera.state;
    const i64 columns = camera.how.columns, rows = camera.how.rows, factor = camera.how.factor;
    const bool steady = camera.how.steady;
    // copies, because the outputs might overlap the originals; unsigned, because a camera may count forever
    u64 base = u64(state.base), now = u64(state.now);
    i64 row = state.row, in_frame = state.in_frame, signal = state.signal;
    Place next = state.next;
    // after the word at which it stops
    i64 end = specials.rows() && samples.rows() ? size : start;
    i64 i = start, events = 0, n_specials = 0, n_samples = 0, falls = 0;
    bool whole = false;

    auto note = [&](Special kind) {
        Span<i64> special = specials[n_specials++];
        special[0] = i;
        special[1] = i64(now);
        special[2] = kind;
        special[3] = events;
        if (n_specials == specials.rows()) end = i + 1;
    };
    auto aim = [&] {
        camera.aim();
        next = state.next;
        signal = state.signal;
    };
    auto special_word = [&](i64 data) {
        Special kind = NONE;
        bool of_columns = 8 <= data && data <= 13;
        if (of_columns) camera.count_pixels(next);
        switch (data) {
        case 1:
            if (steady && state.begun) {
                camera.fault(LATE_RESETS);
                break;
            }
            state.begun = 1;
            state.overflows = 0;
            base = now = 0;
            in_frame = state.in_sample = 0;
            kind = RESET;
            break;
        case 2: kind = FALLING; break;
        case 3: kind = RISING; break;
        case 4: kind = PULSE; break;
        case 5: camera.begin_sample(); break;
        case 7:
            if (camera.end_sample()) {
                Span<i64> sample = samples[n_samples++];
                sample[0] = i;
                sample[1] = i64(now);
                sample[2] = state.contents;
                sample[3] = state.acceleration_scale;
                sample[4] = state.rotation_scale;
                for (int value = 0; value < 7; ++value) sample[5 + value] = state.sample[value];
                if (n_samples == samples.rows()) end = i + 1;
            }
            break;
        case 8:
        case 9:
            in_frame = 1;
            camera.begin_frame(i64(now));
            kind = FRAME_START;
            break;
        case 10:
            if (!in_frame) break;
            kind = FRAME_END;
            whole = camera.end_frame();
            if (whole) end = i + 1;
            break;
        case 11:
        case 12:
            if (in_frame) camera.begin_column(data - 11);
            break;
        case 13:
            if (in_frame) camera.end_column();
            break;
        case 14:
            if (!in_frame) break;
            state.exposure_start = i64(now);
            kind = EXPOSURE_START;
            break;
        case 15:
            if (!in_frame) break;
            state.exposure_end = i64(now);
            kind = EXPOSURE_END;
            break;
        case 16: kind = GENERATOR_FALLING; break;
        case 17: kind = GENERATOR_RISING; break;
        default: camera.fault(UNKNOWN_SPECIAL);
        }
        if (of_columns) aim();
        if (kind != NONE) note(kind);
    };

    for (; i < end; ++i) {
        const i64 word = words[i];
        if (word >= 0x8000) {
            u64 before = now;
            now = base + u64(word & 0x7FFF);
            if (now > before) continue;
            ++falls;
            if (steady && now < before) {
                u64 wraps = (before - now + WRAP_LENGTH - 1) / WRAP_LENGTH;
                camera.fault(LOST_WRAPS, i64(wraps));
                base += wraps * WRAP_LENGTH;
                now += wraps * WRAP_LENGTH;
            }
            continue;
        }
        const i64 data = word & 0xFFF;
        if (word >> 13 == 1) {
            if (data < columns) {
                // there are no more events than words
                t[events] = i64(now);
                x[events] = i16(data);
                y[events] = i16(row);
                p[events] = word >> 12 & 1;
                ++events;
            } else {
                camera.fault(COLUMN_OUT_OF_RANGE);
            }
            continue;
        }
        const i64 code = word >> 12;
        if (code == 1) {
            if (data < rows)
                row = data;
            else
                camera.fault(ROW_OUT_OF_RANGE);
        } else if (code == 4) {
            // samples come in columns, interrupted by events
            if (!in_frame) continue;
            if (next.room > 0 && u64(next.at) < u64(pixels.size())) {
                u16& pixel = pixels[next.at];
                pixel = signal ? light(pixel, data * factor) : u16(data * factor);
                next.at += next.step;
                --next.room;
            } else {
                camera.fault(SURPLUS_PIXELS);
            }
        } else if (code == 7) {
            base += u64(data) * WRAP_LENGTH;
            now = steady ? std::max(base, now) : base;
            if (i64(base >> 31) != state.overflows) {
                // at most one overflow: a word has up to 4,095 wraps, and 2^31 µs are 65,536
                ++state.overflows;
                note(WRAP);
                in_frame = state.in_sample = 0;
            }
        } else if (code == 0) {
            special_word(data);
        } else if (code == 5) {
            if (camera.take_byte(data >> 8, data & 0xFF)) {
                camera.count_pixels(next);
                aim();
            }
        } else if (data >> 10) {
            camera.fault(UNKNOWN_DATA);
        }
    }
    camera.fault(TIME_NOT_RISING, falls);
    camera.count_pixels(next);
    state.base = i64(base);
    state.now = i64(now);
    state.row = row;
    state.in_frame = in_frame;
    store(state, kept);
    return {i, events, n_specials, n_samples, whole};
}

void measure(Rows<const i64> rows, i64 flips, float slope, float zero, Rows<float> acceleration, Rows<float> rotation,
             Span<float> temperature) {
    require(rows.columns() == SAMPLE_VALUES && acceleration.columns() == 3 && rotation.columns() == 3 &&
                acceleration.rows() == rows.rows() && rotation.rows() == rows.rows() &&
                temperature.size() == rows.rows(),
            "samples and measures of different shapes");
    // 16 bits have no +32768; integers are negated, because they have no -0
    auto flipped = [](i64 value, bool flip) {
        return float(flip && value != -32768 ? i64(0 - u64(value)) : value);
    };
    for (i64 n = 0; n < rows.rows(); ++n) {
        Span<const i64> row = rows[n];
        float per_g = float(65536.0 / double(4 << (row[3] & 3)));
        float per_degree = float(65536.0 / double(500 << (row[4] & 3)));
        for (int axis = 0; axis < 3; ++axis) {
            bool flip = flips >> (2 - axis) & 1;
            acceleration(n, axis) = flipped(row[5 + axis], flip) / per_g;
            rotation(n, axis) = flipped(row[9 + axis], flip) / per_degree;
        }
        temperature[n] = row[2] & TEMPERATURE ? float(row[8]) / slope + zero : 0.0f;
    }
}

// `sent`: µs of the wraps so far, the last time and row sent, -1 for none.
i64 encode(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<i64> sent, Span<u16> words) {
    Events(t, x, y, p);  // equally long
    require(sent.size() == 3, "the state of another encoder");
    i64 n = 0;
    auto send = [&](i64 word) {
        require(n < words.size(), "more words than there is room for");
        words[n++] = u16(word);
    };
    i64 wrapped = sent[0], now = sent[1], row = sent[2];
    for (i64 i = 0; i < t.size(); ++i) {
        bool fresh = t[i] != now;
        if (fresh) {
            now = t[i];
            // unsigned, because times have no bounds
            i64 wraps = i64(u64(now) - u64(wrapped)) >> 15;
            wrapped = i64(u64(wrapped) + (u64(wraps) << 15));
            for (; wraps > 0; wraps -= MOST_WRAPS) send(0x7000 | std::min(wraps, MOST_WRAPS));
            if (now > wrapped) send(0x8000 | (now - wrapped));
        }
        if (fresh || y[i] != row) {
            row = y[i];
            send(0x1000 | row);
        }
        send((p[i] ? 0x3000 : 0x2000) | x[i]);
    }
    sent[0] = wrapped, sent[1] = now, sent[2] = row;
    return n;
}

}  // namespace davis

void define_davis_stream(nb::module_& module) {
    define<davis::decode>(module, "davis_decode");
    define<davis::measure>(module, "davis_measure");
    define<davis::encode>(module, "davis_encode");
}

}  // namespace nvsdata
