// A sensor whose pixels compare their level with that at their last event, and the levels from frames.
#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "../native/times.h"
#include "brightness.h"
#include "keys.h"
#include "tiles.h"

namespace nvsdata {

constexpr i64 NEVER = LATEST;          // µs
constexpr double SOMEDAY = 1LL << 61;  // µs, longer than all other times

// Time in µs after which something happens, as an integer.
inline i64 pause(double time) { return clamped(time, i64(SOMEDAY)); }

// A frame and the previous one. `given` replaces the logarithm of the frame's bytes, unless it is empty.
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
    // Thresholds of the pixels of a row; empty if all are equal.
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
    require(sensor.thresholds.size() == 2 && (sensor.each.empty() || sensor.each.size() == 2 * height * width),
            "thresholds don't fit pixels");
    require(sensor.off() > 0 && sensor.on() > 0 && sensor.leak >= 0 && sensor.dark >= 0 && sensor.dark <= 1'000'000'000,
            "settings out of range");
    require(before >= 0 && now > before && now - before < LONGEST && now < NEVER, "times must rise");
}

// Visits the rows of tiles that changed or wake, and finds the levels of their pixels.
template <class Number>
class Rousing {
public:
    Rousing(const Light<Number>& light, const Sensor<Number>& sensor, const PixelArray<Number>& array)
        : end(array.width()), light_(light), array_(array),
          logarithms_(array.width(), light.first_weight, sensor.table, i32(sensor.dark), 0, 1),
          active_(new bool[std::size_t(array.dirty.columns()) + 1]) {
        if (i64 bytes = array.width() ? light.frame.columns() / array.width() : 0)
            find_dirty(light.frame, light.previous, bytes * TILE_COLUMNS, array.dirty);
    }

    std::vector<Number> end;  // levels of a row, in active tiles

    Span<const bool> active() const { return {active_.get(), array_.dirty.columns()}; }

    // Call each(row of pixels) for the rows in tiles that changed or wake at `now`, with their levels in `end`.
    template <class Each>
    void each_row(i64 now, Each each) {
        for (i64 r = 0; r < array_.dirty.rows(); ++r) {
            if (!rouse(r, now)) continue;
            for (i64 y = r * TILE_ROWS; y < std::min((r + 1) * TILE_ROWS, array_.height()); ++y) {
                find(y);
                each(y);
            }
        }
    }

    // Copy the levels of a row that changed from `end`.
    void keep(i64 y) {
        each_run(array_.dirty[y / TILE_ROWS], i64(end.size()), [&](i64 left, i64 right) {
            Span<Number> level = array_.level[y].part(left, right);
            std::copy(end.begin() + left, end.begin() + right, level.begin());
        });
    }

private:
    const Light<Number>& light_;
    const PixelArray<Number>& array_;
    Logarithms<Number> logarithms_;
    std::unique_ptr<bool[]> active_;

    // Mark the tiles of a row that changed or wake at `now`, and remove their time to wake; return whether there is
    // any.
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
                logarithms_(light_.frame[y], left, right, to);
            }
        });
    }
};

}  // namespace nvsdata
