// Neighbors of the events in a sliding window: after every step they equal those of `near_sources`.
//
// Events are numbered in the order in which they arrive. The numbers of the events of a pixel are adjacent in memory,
// so that those next to a time are found by binary search. A new event can be among the k nearest neighbors only of the
// newest k events of a pixel, and an event that leaves only of the oldest k, because events of one pixel are nearer to
// each other. So a step tests at most k events of each pixel nearby.
#pragma once

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "../native/require.h"
#include "../native/steps.h"
#include "../native/wrap.h"
#include "columns.h"

namespace nvsdata::streaming {

constexpr i64 MOST_EVENTS = i64(1) << 28;  // places of the events of pixels are 32-bit numbers
constexpr i64 MOST_PIXELS = i64(1) << 30;  // pixels of a sensor are 32-bit numbers, too

// Distances of events: see `near_sources`.
struct Metric {
    struct Offset {
        i32 x, y;      // from an event to a pixel that may be near
        double apart;  // alpha times the squared distance
    };
    double radius, alpha, beta, limit;  // limit: largest squared distance
    std::vector<Offset> offsets;        // nearest first

    // The metric of a graph whose nodes are at most `most` pixels apart along an axis.
    Metric(double r, double a, double b, i64 most) : radius(r), alpha(a), beta(b), limit(r * r) {
        require(radius > 0 && alpha > 0 && beta >= 0, "radius and alpha must be above 0");
        // one more, because the quotient may be rounded down
        i64 side = i64(std::min(radius / std::sqrt(alpha) + 1, double(most)));
        for (const Step& step : steps_around(side, [&](i64 square) { return alpha * double(square) <= limit; }))
            offsets.push_back({i32(step.dx), i32(step.dy), alpha * double(step.square)});
    }
};

class Window {
public:
    i64 width, height, k;
    i64 first = 0, next = 0;  // numbers of the first event in the window and of the next new one
    Column<i64> t;            // by row
    Column<i32> x, y;
    Table<i64> source;  // neighbors of each event, and squared distances; `degree` of them are valid
    Table<double> far;
    Column<i32> degree, worst;  // worst: place of the farthest neighbor

    struct Pixel {
        i32 base = 0, room = 0, begin = 0, size = 0;  // reserved range in `slots`; range of the events
        i32 end() const { return begin + size; }
    };
    Column<Pixel> pixels;
    Column<i64> slots;  // numbers of the events of each pixel, ascending

    Window(i64 wide, i64 high, i64 room, i64 neighbors)
        : width(wide), height(high), k(neighbors), t(room), x(room), y(room), source(room, k), far(room, k),
          degree(room), worst(room), pixels(width * height), slots(4 * room + 4) {}

    i64 capacity() const { return t.size(); }
    i64 size() const { return next - first; }
    i64 row_of(i64 number) const { return number & (t.size() - 1); }
    bool is_inside(i64 u, i64 v) const { return u >= 0 && u < width && v >= 0 && v < height; }
    Place place(i64 row) const { return {x[row], y[row], t[row]}; }
    i64 pixel_of(i64 row) const { return y[row] * width + x[row]; }
    // Number of the oldest event whose row isn't overwritten yet: rows of removed events may still be needed.
    i64 oldest() const { return std::max(next - t.size(), i64(0)); }

    // Append an event, without neighbors.
    void push(i64 time, i32 column, i32 line) {
        i64 row = row_of(next);
        t[row] = time, x[row] = column, y[row] = line, degree[row] = 0;
        Pixel& pixel = pixels[pixel_of(row)];
        if (pixel.end() == pixel.base + pixel.room) make_room(pixel);
        slots[pixel.end()] = next++;
        ++pixel.size;
    }

    // Remove the oldest event from its pixel; its row stays until it is overwritten.
    void pop() {
        Pixel& pixel = pixels[pixel_of(row_of(first++))];
        ++pixel.begin;
        --pixel.size;
    }

    // Find the neighbors of an event from scratch. O(pixels up to the farthest neighbor · k).
    void search(i64 number, const Metric& metric) {
        i64 row = row_of(number);
        i32 column = x[row], line = y[row];
        degree[row] = 0;
        for (const Metric::Offset& offset : metric.offsets) {
            if (degree[row] == k && offset.apart > far(row, worst[row])) break;
            i64 u = column + offset.x, v = line + offset.y;
            if (!is_inside(u, v)) continue;
            const Pixel& pixel = pixels[v * width + u];
            if (pixel.size) offer_pixel(number, row, pixel, offset.apart, metric);
        }
    }

    // Add an event as a neighbor if it is among the nearest; returns whether it is.
    bool offer(i64 row, i64 other, double apart, const Metric& metric) {
        double gap = double(gap_to(row, other)), here = apart + metric.beta * (gap * gap);
        if (here > metric.limit) return false;
        i32 count = degree[row], last = worst[row];
        if (count < k) {
            source(row, count) = other, far(row, count) = here;
            ++degree[row];
            if (count == 0 || comes_after(row, count, last)) worst[row] = count;
            return true;
        }
        if (here > far(row, last)) return false;
        if (here == far(row, last)) {
            i64 old = source(row, last), mine = gap_to(row, other), its = gap_to(row, old);
            if (mine > its || (mine == its && other > old)) return false;
        }
        source(row, last) = other, far(row, last) = here;
        find_farthest(row);
        return true;
    }

    void find_farthest(i64 row) {
        i32 last = 0;
        for (i32 n = 1; n < degree[row]; ++n)
            if (comes_after(row, n, last)) last = n;
        worst[row] = last;
    }

    void grow(i64 room) {
        if (room > MOST_EVENTS) throw std::length_error("more than 268,435,456 events in a window");
        i64 from = oldest();
        Column<i64> wide(4 * room + 4);
        std::copy(Span<i64>(slots).begin(), Span<i64>(slots).end(), Span<i64>(wide).begin());
        slots = std::move(wide);
        widen(x, room, from, next);
        widen(y, room, from, next);
        widen(source, room, from, next);
        widen(far, room, from, next);
        widen(degree, room, from, next);
        widen(worst, room, from, next);
        widen(t, room, from, next);
    }

private:
    i32 used_ = 0;  // end of the reserved part of `slots`

    // Differences of times may need all 64 bits.
    i64 gap_to(i64 row, i64 other) const { return gap(t[row_of(other)], t[row]); }

    // Reserve a slot for another event of a pixel; from time to time, twice as many as it has events.
    void make_room(Pixel& pixel) {
        i32 base = pixel.base;
        if (2 * pixel.size >= pixel.room) {
            i32 need = 2 * pixel.size + 2;
            // afterwards twice the number of events is reserved, which is at most half of the slots
            if (used_ + i64(need) > slots.size()) repack();
            base = used_;
            used_ += need;
            pixel.room = need;
        }
        // the target may overlap the source, and comes before it
        for (i32 n = 0; n < pixel.size; ++n) slots[base + n] = slots[pixel.begin + n];
        pixel.base = pixel.begin = base;
    }

    // Reserve twice the slots that each pixel needs.
    void repack() {
        Column<i64> old = slots;
        used_ = 0;
        for (i64 p = 0; p < pixels.size(); ++p) {
            Pixel& pixel = pixels[p];
            for (i32 n = 0; n < pixel.size; ++n) slots[used_ + n] = old[pixel.begin + n];
            pixel.base = pixel.begin = used_;
            pixel.room = 2 * pixel.size;
            used_ += pixel.room;
        }
    }

    // Offer the events of a pixel to an event as neighbors: first newer ones outward, then older ones by runs of equal
    // times.
    void offer_pixel(i64 number, i64 row, const Pixel& pixel, double apart, const Metric& metric) {
        const i64* all = Span<i64>(slots).part(pixel.begin, pixel.end()).begin();
        const i64* end = all + pixel.size;
        const i64* from = std::lower_bound(all, end, number);
        for (const i64* other = from; other != end; ++other)
            if (*other != number && !offer(row, *other, apart, metric)) break;
        for (const i64* last = from; last != all;) {
            const i64* run = start_of_run(all, last);
            for (const i64* other = run; other != last; ++other)
                if (!offer(row, *other, apart, metric)) return;
            last = run;
        }
    }

    // The first event at the time of the event before `last`. Events near `last` are tried first.
    const i64* start_of_run(const i64* all, const i64* last) const {
        i64 time = t[row_of(last[-1])], step = 1;
        const i64* low = last - 1;
        for (; low - all >= step && t[row_of(low[-step])] == time; step *= 2) low -= step;
        const i64* from = low - all >= step ? low - step : all;
        return std::lower_bound(from, low, time, [&](i64 other, i64 value) { return t[row_of(other)] < value; });
    }

    // Whether a neighbor is farther than another; ties: the one farther in time, then the later one.
    bool comes_after(i64 row, i32 a, i32 b) const {
        if (far(row, a) != far(row, b)) return far(row, a) > far(row, b);
        i64 one = gap_to(row, source(row, a)), other = gap_to(row, source(row, b));
        return one > other || (one == other && source(row, a) > source(row, b));
    }
};

// The next power of two.
inline i64 capacity_for(i64 count) {
    i64 capacity = 1;
    while (capacity < count) capacity *= 2;
    return capacity;
}

}  // namespace nvsdata::streaming
