// A sensor whose pixels compare with their level at their last event, and the levels that frames give them.
#pragma once

#include <algorithm>
#include <stdexcept>
#include <vector>

#include "brightness.h"
#include "keys.h"
#include "tiles.h"

namespace nvsdata {

constexpr i64 NEVER = i64(1) << 62;    // µs
constexpr double SOMEDAY = 1LL << 61;  // µs: a pause that ends after all others

// µs after which something happens, as an integer.
inline i64 pause(double time) { return clamped(time, i64(SOMEDAY)); }

// A frame and the one before it; `given` replaces the logarithm of the frame's bytes, unless it is empty.
template <class Number>
struct Light {
    Rows<const u8> frame, previous;
    i64 first_weight;
    Rows<const Number> given;
};

// See the NamedTuples of the same names in Python.
template <class Number>
struct Sensor {
    Span<const Number> table;
    i64 dark;
    Span<const Number> thresholds, each;
    double leak;

    Number off() const { return thresholds[0]; }
    Number on() const { return thresholds[1]; }
    // Of the pixels of a row; empty where all are alike.
    Span<const Number> off(i64 y, i64 width) const { return part(y * width, width); }
    Span<const Number> on(i64 y, i64 width) const { return part(each.size() / 2 + y * width, width); }

private:
    Span<const Number> part(i64 from, i64 width) const {
        return each.empty() ? Span<const Number>() : each.part(from, from + width);
    }
};

template <class Number>
struct PixelArray {
    Rows<Number> level, memory;
    Rows<bool> dirty;
    Rows<i64> wake;
    i64 height() const { return level.rows(); }
    i64 width() const { return level.columns(); }
};

template <class Number>
void check_sensor(const Light<Number>& light, const Sensor<Number>& sensor, const PixelArray<Number>& array, i64 before,
                  i64 now) {
    i64 height = array.height(), width = array.width();
    i64 bytes = check_frames(light.frame, light.previous, height, width);
    if (light.given.rows())
        check_pixels(light.given.rows(), light.given.columns(), height, width);
    else
        check_light(bytes, light.first_weight, sensor.table.size(), sizeof(Number) == 4);
    check_pixels(array.memory.rows(), array.memory.columns(), height, width);
    check_tiles(array.dirty, height, width);
    check_pixels(array.wake.rows(), array.wake.columns(), array.dirty.rows(), array.dirty.columns());
    check_addresses(height, width);
    if (sensor.thresholds.size() != 2 || (sensor.each.size() && sensor.each.size() != 2 * height * width))
        throw std::invalid_argument("thresholds don't fit pixels");
    if (!(sensor.off() > 0 && sensor.on() > 0 && sensor.leak >= 0) || sensor.dark < 0 || sensor.dark > 1'000'000'000)
        throw std::invalid_argument("settings out of range");
    if (before < 0 || now <= before || now - before >= LONGEST || now >= NEVER)
        throw std::invalid_argument("times must rise");
}

// Goes through the rows of tiles that changed, or that wake, and finds the levels of their pixels.
template <class Number>
class Rousing {
public:
    Rousing(const Light<Number>& light, const Sensor<Number>& sensor, const PixelArray<Number>& array)
        : end(array.width()), light_(light), sensor_(sensor), array_(array), thousandths_(array.width()),
          active_(new bool[std::size_t(array.dirty.columns()) + 1]) {
        if (i64 bytes = array.width() ? light.frame.columns() / array.width() : 0)
            find_dirty(light.frame, light.previous, bytes * TILE_COLUMNS, array.dirty);
    }

    std::vector<Number> end;  // levels of a row, in active tiles

    Span<const bool> active() const { return {active_.get(), array_.dirty.columns()}; }

    // Which tiles of a row changed, or wake at `now`; whether any does. They have no time to wake at then.
    bool rouse(i64 r, i64 now) {
        Span<bool> active(active_.get(), array_.dirty.columns());
        bool some = false;
        for (i64 c = 0; c < active.size(); ++c) {
            active[c] = array_.dirty(r, c) || array_.wake(r, c) <= now;
            if (active[c]) array_.wake(r, c) = NEVER;
            some |= active[c];
        }
        return some;
    }

    // Write the levels of a row to `end`.
    void find(i64 y) {
        Span<const bool> dirty = array_.dirty[y / TILE_ROWS];
        Span<Number> level = array_.level[y], out(end);
        for (i64 c = 0; c < dirty.size(); ++c)
            if (active()[c] && !dirty[c]) {
                i64 left = c * TILE_COLUMNS, right = std::min(left + TILE_COLUMNS, level.size());
                std::copy(level.data() + left, level.data() + right, out.part(left, right).data());
            }
        each_run(dirty, out.size(), [&](i64 left, i64 right) {
            Span<Number> to = out.part(left, right);
            if (light_.given.rows()) {
                Span<const Number> given = light_.given[y].part(left, right);
                std::copy(given.begin(), given.end(), to.begin());
            } else {
                logarithms(light_.frame[y], left, right, to);
            }
        });
    }

    // Levels of a row that changed, from `end`.
    void keep(i64 y) {
        each_run(array_.dirty[y / TILE_ROWS], i64(end.size()), [&](i64 left, i64 right) {
            Span<Number> level = array_.level[y].part(left, right);
            std::copy(end.begin() + left, end.begin() + right, level.begin());
        });
    }

private:
    const Light<Number>& light_;
    const Sensor<Number>& sensor_;
    const PixelArray<Number>& array_;
    std::vector<i32> thousandths_;
    std::unique_ptr<bool[]> active_;

    // ln(q + dark) of gray or color bytes.
    void logarithms(Span<const u8> row, i64 left, i64 right, Span<Number> out) {
        if (row.size() == array_.width()) return look_up(row.part(left, right), sensor_.table, out);
        Span<i32> thousandths(thousandths_.data(), out.size());
        weigh(row.part(3 * left, 3 * right), light_.first_weight, thousandths);
        if constexpr (sizeof(Number) == 4) {
            if (sensor_.table.empty()) {
                for (i32& q : thousandths) q += i32(sensor_.dark);
                return logarithm(Span<const i32>(thousandths), 0.0f, 1.0f, out);
            }
        }
        look_up(Span<const i32>(thousandths), sensor_.table, out);
    }
};

}  // namespace nvsdata
