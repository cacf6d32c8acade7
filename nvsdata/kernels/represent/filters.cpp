// Masks of the events that pass a filter.
#include <vector>

#include "../native/bind.h"
#include "../native/levels.h"
#include "events.h"

namespace nvsdata {

namespace {

constexpr i64 NEVER = std::numeric_limits<i64>::min();

void not_refractory(Span<const i64> t, Span<const i16> x, Span<const i16> y, i64 period, Rows<i64> last,
                    Span<bool> keep) {
    require_columns(t.size(), {x, y});
    require_shapes(keep.size() == t.size());
    Span<i64> passed = last.flat();
    each_event({last.columns(), last.rows()}, {x, y}, [&](i64 i, i64 place) {
        keep[i] = passed[place] <= minus(t[i], period);
        if (keep[i]) passed[place] = t[i];
    });
}

// Boxes of side x side pixels, row by row.
struct Boxes {
    u32 side;
    i64 columns;
    // The box of an event. Events must be on a sensor that the boxes cover.
    i64 place(i16 x, i16 y) const { return u32(y) / side * columns + u32(x) / side; }
};

// Check the side of boxes, which may be larger than any sensor.
Boxes boxes_of(i64 side, i64 columns) {
    require(side >= 1 && side <= 32768, "boxes must have a side");
    return {u32(side), columns};
}

Images sensor_of(const Boxes& boxes, i64 rows) { return {boxes.columns * boxes.side, rows * boxes.side}; }

void first_of_boxes(Span<const i64> t, Span<const i16> x, Span<const i16> y, i64 side, i64 duration, i64 most,
                    Rows<i64> box, Rows<i64> count, Span<bool> keep) {
    require_columns(t.size(), {x, y});
    require(duration >= 1, "boxes must have a duration");
    require_shapes(keep.size() == t.size() && box.rows() == count.rows() && box.columns() == count.columns());
    Boxes boxes = boxes_of(side, box.columns());
    Span<i64> latest = box.flat(), kept = count.flat();
    each_event(sensor_of(boxes, box.rows()), {x, y}, [&](i64 i, i64) {
        i64 place = boxes.place(x[i], y[i]), now = floor_divide(t[i], duration);
        if (latest[place] != now) latest[place] = now, kept[place] = 0;
        keep[i] = kept[place] < most;
        kept[place] += keep[i];
    });
}

void within_rate(Span<const i64> t, Span<const i16> x, Span<const i16> y, i64 side, i64 interval, i64 burst,
                 Rows<i64> due, Span<bool> keep) {
    require_columns(t.size(), {x, y});
    require_shapes(keep.size() == t.size());
    Boxes boxes = boxes_of(side, due.columns());
    Span<i64> free_at = due.flat();
    i64 ahead = times(minus(burst, 1), interval);
    each_event(sensor_of(boxes, due.rows()), {x, y}, [&](i64 i, i64) {
        i64 place = boxes.place(x[i], y[i]);
        keep[i] = free_at[place] <= plus(t[i], ahead);
        if (keep[i]) free_at[place] = plus(std::max(free_at[place], t[i]), interval);
    });
}

void supported_by_neighbors(Span<const i64> t, Span<const i16> x, Span<const i16> y, i64 rows, i64 columns, i64 window,
                            Span<bool> keep) {
    require_columns(t.size(), {x, y});
    require_shapes(keep.size() == t.size() && rows >= 2 && columns >= 2 && rows <= 32770 && columns <= 32770);
    std::vector<i64> latest_of(std::size_t(rows * columns), NEVER);
    Span<i64> last(latest_of);
    each_event({columns - 2, rows - 2, columns, rows * columns}, {x, y}, [&](i64 i, i64 place) {
        // because of the border, this is the place of the pixel up and to the left
        Span<i64> above = last.part(place, place + 3), same = last.part(place + columns, place + columns + 3);
        Span<i64> below = last.part(place + 2 * columns, place + 2 * columns + 3);
        i64 latest = std::max({above[0], above[1], above[2], same[0], same[2], below[0], below[1], below[2]});
        keep[i] = latest >= minus(t[i], window);
        same[1] = t[i];
    });
}

void count_into(Span<const i16> x, Span<const i16> y, Rows<i64> out) {
    require_columns(x.size(), {x, y});
    Span<i64> counts = out.flat();
    each_event({out.columns(), out.rows()}, {x, y}, [&](i64, i64 place) { ++counts[place]; });
}

NVSDATA_INLINE void mark_within(const i16* x, const i16* y, i64 count, i16 left, i16 right, i16 top, i16 bottom,
                                     bool* inside) {
    for (i64 i = 0; i < count; ++i)
        inside[i] = (x[i] >= left) & (x[i] <= right) & (y[i] >= top) & (y[i] <= bottom);
}

i16 coordinate(i64 value) { return i16(std::clamp<i64>(value, -32768, 32767)); }

void in_rectangle(Span<const i16> x, Span<const i16> y, i64 left, i64 top, i64 right, i64 bottom, Span<bool> inside) {
    require_columns(x.size(), {x, y});
    require_shapes(inside.size() == x.size());
    if (left > 32767 || top > 32767 || right < -32768 || bottom < -32768)
        std::fill(inside.begin(), inside.end(), false);
    else
        best<mark_within>(x.data(), y.data(), x.size(), coordinate(left), coordinate(right), coordinate(top),
                    coordinate(bottom), inside.data());
}

}  // namespace

void define_filters(nb::module_& module) {
    define<not_refractory>(module, "not_refractory");
    define<first_of_boxes>(module, "first_of_boxes");
    define<within_rate>(module, "within_rate");
    define<supported_by_neighbors>(module, "supported_by_neighbors");
    define<count_into>(module, "count_into");
    define<in_rectangle>(module, "in_rectangle");
}

}  // namespace nvsdata
