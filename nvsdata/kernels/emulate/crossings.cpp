// Pixels that compare their level with that at their last event, one frame at a time: see `nvsdata.emulation.DVS`.
#include "sensor.h"

#include <cmath>

#include "../native/bind.h"
#include "../native/interrupt.h"

namespace nvsdata {

namespace {

constexpr double SLACK = 1.0 / (1 << 24);  // fraction of a threshold by which tiles wake early, because of rounding

template <class Number>
NVSDATA_INLINE void mark_crossed(Span<const Number> end, Span<const Number> memory, Number drift, Number off, Number on,
                                 Span<u8> mark) {
    for (i64 i = 0; i < mark.size(); ++i) {
        Number d = end[i] - memory[i] + drift;
        mark[i] = (d >= on) | (-d >= off);
    }
}

template <class Number>
NVSDATA_INLINE void mark_crossed_each(Span<const Number> end, Span<const Number> memory, Number drift,
                                      Span<const Number> off, Span<const Number> on, Span<u8> mark) {
    for (i64 i = 0; i < mark.size(); ++i) {
        Number d = end[i] - memory[i] + drift;
        mark[i] = (d >= on[i]) | (-d >= off[i]);
    }
}

// Number of events, time from one to the next, time of the first, lower half of the keys; number of all events.
template <class Number, class Time>
NVSDATA_INLINE void time_events(Span<const Number> moved, Span<const Number> rise, Span<const Number> step,
                                Span<const u16> x, u32 row, Time span, Span<i32> count, Span<Time> later,
                                Span<Time> first, Span<u32> low, i64* total) {
    i64 m = moved.size(), sum = 0;
    Number top = largest_i32<Number>;
    for (i64 j = 0; j < m; ++j) {
        Number steps = std::abs(moved[j]) / step[j];
        count[j] = i32(steps < top ? steps : top);
        low[j] = row | u32(x[j]) << 1 | u32(moved[j] > 0);
    }
    for (i64 j = 0; j < m; ++j) sum += count[j];
    for (i64 j = 0; j < m; ++j) {
        // rounding may leave a pixel at its threshold; it then fires at the beginning of the next frame
        Number change = std::abs(moved[j] - rise[j]), beyond = std::abs(moved[j]) - step[j];
        Time slope = change > 0 ? span / change : Time(0);
        later[j] = step[j] * slope;
        first[j] = change > 0 ? span - beyond * slope : Time(0);
    }
    *total = sum;
}

// Times of the first three events of pixels; times beyond their `count` are ignored.
template <class Time>
NVSDATA_INLINE void three_times(Span<const Time> first, Span<const Time> later, Span<u32> one, Span<u32> two,
                                Span<u32> three) {
    constexpr double top = largest_i32<double>;
    for (i64 j = 0; j < first.size(); ++j) {
        double a = double(first[j]), gap = double(later[j]);
        double b = a + gap + 0.5, c = a + 2 * gap + 0.5;
        a += 0.5;
        a = a > 0 ? a : 0, b = b > 0 ? b : 0, c = c > 0 ? c : 0;
        one[j] = u32(i32(a < top ? a : top));
        two[j] = u32(i32(b < top ? b : top));
        three[j] = u32(i32(c < top ? c : top));
    }
}

// `Time` is the type in which times are calculated.
template <class Number, class Time>
class Crossings {
public:
    Crossings(const Light<Number>& light, const Sensor<Number>& sensor, const PixelArray<Number>& array, i64 before,
              i64 now)
        : rousing_(light, sensor, array),
          sensor_(sensor),
          array_(array),
          now_(now),
          span_(now - before),
          past_(Number(sensor.leak * double(before))),
          drift_(Number(sensor.leak * double(now))),
          marks_(array.width()),
          rise_(array.width()),
          moved_(array.width()),
          step_(array.width()),
          later_(array.width()),
          first_(array.width()),
          count_(array.width()),
          low_(array.width()),
          one_(array.width()),
          two_(array.width()),
          three_(array.width()) {}

    void run(Keys& keys) {
        Interrupt interrupt;
        rousing_.each_row(now_, [&](i64 y) {
            if (i64 m = fired(y)) fire(y, m, keys);
            rousing_.keep(y);
            if (sensor_.leak > 0) set_wake(y);
            if (y % TILE_ROWS == 0) interrupt.poll();
        });
    }

private:
    Rousing<Number> rousing_;
    const Sensor<Number>& sensor_;
    const PixelArray<Number>& array_;
    i64 now_, span_;
    Number past_, drift_;  // decrease of memories by leak until the last frame and until this one
    RowMarks marks_;
    // for the pixels of a row that fire: levels above their memories before and now, thresholds, times
    std::vector<Number> rise_, moved_, step_;
    std::vector<Time> later_, first_;
    std::vector<i32> count_;
    std::vector<u32> low_, one_, two_, three_;

    // List the pixels of a row that have reached their thresholds; return their number.
    i64 fired(i64 y) {
        i64 width = array_.width();
        Span<const Number> levels(rousing_.end), memories = array_.memory[y];
        Span<const Number> off = sensor_.off(y, width), on = sensor_.on(y, width);
        return marks_.list(rousing_.active(), width, [&](i64 left, i64 right, Span<u8> mark) {
            Span<const Number> level = levels.part(left, right), memory = memories.part(left, right);
            if (on.empty())
                best<mark_crossed<Number>>(level, memory, drift_, sensor_.off(), sensor_.on(), mark);
            else
                best<mark_crossed_each<Number>>(level, memory, drift_, off.part(left, right), on.part(left, right),
                                                mark);
        });
    }

    // Add the events of `m` pixels whose levels change to `end`, as keys, and update their memories.
    void fire(i64 y, i64 m, Keys& keys) {
        Span<const u16> x(marks_.place.data(), m);
        Span<Number> memory = array_.memory[y], level = array_.level[y], end(rousing_.end);
        Span<const Number> off = sensor_.off(y, array_.width()), on = sensor_.on(y, array_.width());
        Span<Number> moved(moved_.data(), m), rise(rise_.data(), m), step(step_.data(), m);
        bool are_positive = true;
        for (i64 j = 0; j < m; ++j) {
            i64 i = x[j];
            moved[j] = end[i] - memory[i] + drift_;
            rise[j] = level[i] - memory[i] + past_;
            step[j] = moved[j] > 0 ? (on.empty() ? sensor_.on() : on[i]) : (off.empty() ? sensor_.off() : off[i]);
            are_positive &= step[j] > 0;
        }
        require(are_positive, "thresholds must be above 0");
        Span<Time> later(later_.data(), m), first(first_.data(), m);
        Span<i32> count(count_.data(), m);
        Span<u32> low(low_.data(), m), one(one_.data(), m), two(two_.data(), m), three(three_.data(), m);
        i64 total;
        best<time_events<Number, Time>>(moved, rise, step, x, u32(y) << 17, Time(span_), count, later, first, low,
                                        &total);
        for (i64 j = 0; j < m; ++j) {
            double spent = double(step[j]) * count[j];
            Number& kept = memory[x[j]];
            kept = Number(double(kept) + (moved[j] > 0 ? spent : -spent));
            if (double(std::abs(moved[j])) - spent >= double(step[j]))
                array_.wake(y / TILE_ROWS, x[j] / TILE_COLUMNS) = now_;
        }
        best<three_times<Time>>(first, later, one, two, three);
        u64* out = keys.room(total + FEW);
        for (i64 j = 0; j < m; ++j) {
            // all three are always written; the next pixel overwrites the unused ones
            out[0] = u64(one[j]) << 32 | low[j];
            out[1] = u64(two[j]) << 32 | low[j];
            out[2] = u64(three[j]) << 32 | low[j];
            for (i32 k = FEW; k < count[j]; ++k)
                out[k] = clamped(double(first[j]) + k * double(later[j]) + 0.5, i64(UINT32_MAX)) << 32 | low[j];
            out += count[j];
        }
        keys.add(total);
    }

    // Make tiles of a row wake earlier, because memory leaks.
    void set_wake(i64 y) {
        double leak = sensor_.leak, fallen = leak * double(now_);
        Span<const Number> level = array_.level[y], memory = array_.memory[y], on = sensor_.on(y, array_.width());
        Span<i64> wake = array_.wake[y / TILE_ROWS];
        for (i64 tile = 0; tile < wake.size(); ++tile) {
            if (!rousing_.active()[tile] || wake[tile] <= now_) continue;
            double least = SOMEDAY * leak;
            for (i64 i = tile * TILE_COLUMNS; i < std::min((tile + 1) * TILE_COLUMNS, level.size()); ++i) {
                double threshold = on.empty() ? sensor_.on() : on[i];
                least = std::min(least, threshold * (1 - SLACK) - (double(level[i]) + fallen - double(memory[i])));
            }
            wake[tile] = least <= 0 ? now_ : std::min(wake[tile], now_ + pause(least / leak));
        }
    }
};

}  // namespace

template <class Number>
Keys::Result advance(Rows<const u8> frame, Rows<const u8> previous, i64 first_weight, Rows<const Number> given,
                     Span<const Number> table, i64 dark, Span<const Number> thresholds, Span<const Number> each,
                     double leak, Rows<Number> level, Rows<Number> memory, Rows<bool> dirty, Rows<i64> wake, i64 before,
                     i64 now, Span<u64> place) {
    Light<Number> light{frame, previous, first_weight, given};
    Sensor<Number> sensor{table, dark, thresholds, each, leak};
    PixelArray<Number> array{level, memory, dirty, wake};
    check_sensor(light, sensor, array, before, now);
    Keys keys(place);
    // in float32, time has 24 bits
    if (now - before > 1 << 21)
        Crossings<Number, double>(light, sensor, array, before, now).run(keys);
    else
        Crossings<Number, Number>(light, sensor, array, before, now).run(keys);
    return keys.result();
}

void define_crossings(nb::module_& module) {
    define<advance<float>, advance<double>>(module, "advance");
}

}  // namespace nvsdata
