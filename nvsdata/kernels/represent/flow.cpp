// Optical flow from planes that are fitted to the surfaces of active events (Benosman et al. 2014).
#include <array>
#include <cmath>

#include "../native/bind.h"
#include "events.h"

namespace nvsdata {

namespace {

// The last event of a pixel: position and time relative to the event in the center.
struct Near {
    i32 x, y;
    double t;
};

constexpr i64 LARGEST = 8;  // radius
constexpr i64 MOST = (2 * LARGEST + 1) * (2 * LARGEST + 1);

// The plane t = x * by_x + y * by_y + at_center.
struct Plane {
    double by_x, by_y, at_center;
    double distance(const Near& event) const {
        return std::abs(event.t - (double(event.x) * by_x + double(event.y) * by_y + at_center));
    }
};

// Fit a plane by least squares; false if the events are on one line.
bool fit(Span<const Near> events, Plane& plane) {
    i64 n = events.size(), x = 0, y = 0, xx = 0, xy = 0, yy = 0;
    double t = 0, xt = 0, yt = 0;
    for (const Near& event : events) {
        x += event.x, y += event.y;
        xx += event.x * event.x, xy += event.x * event.y, yy += event.y * event.y;
        t += event.t, xt += double(event.x) * event.t, yt += double(event.y) * event.t;
    }
    // moments about the mean, times n; those of positions are exact
    i64 cxx = n * xx - x * x, cxy = n * xy - x * y, cyy = n * yy - y * y, determinant = cxx * cyy - cxy * cxy;
    if (determinant == 0) return false;
    double cxt = double(n) * xt - double(x) * t, cyt = double(n) * yt - double(y) * t;
    plane.by_x = (double(cyy) * cxt - double(cxy) * cyt) / double(determinant);
    plane.by_y = (double(cxx) * cyt - double(cxy) * cxt) / double(determinant);
    plane.at_center = (t - double(x) * plane.by_x - double(y) * plane.by_y) / double(n);
    return true;
}

struct Rules {
    double tolerance;
    i64 least;
};

// Fit a plane, and repeat without the events that are too far from it, until there are none.
bool fit_without_outliers(Span<Near> events, const Rules& rules, Plane& plane) {
    for (;;) {
        if (events.size() < rules.least || !fit(events, plane)) return false;
        i64 kept = 0;
        for (const Near& event : events) {
            events[kept] = event;
            kept += !(plane.distance(event) > rules.tolerance);
        }
        if (kept == events.size()) return true;
        events = events.part(0, kept);
    }
}

void plane_flow(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 radius, i64 window,
                double tolerance, i64 least, Array<i64, 3> latest, Rows<float> out) {
    Pixels events{x, y, p, Polarity::off_first};
    require_columns(t.size(), events);
    auto [polarities, rows, columns] = latest.shape;
    require(radius >= 1 && radius <= LARGEST, "the radius must be from 1 to 8");
    require_shapes(polarities == 2 && out.rows() == t.size() && out.columns() == 3);
    require_margin(radius, rows, columns);
    Rules rules{tolerance, least};
    Span<i64> surface = latest.values;
    std::array<Near, MOST> storage;
    Span<Near> near(storage);
    i64 stride = columns;
    each_event({columns - 2 * radius, rows - 2 * radius, columns, rows * columns}, events, [&](i64 i, i64 place) {
        // because of the margin, `place` is the pixel `radius` to the left and above
        surface[place + radius * stride + radius] = t[i];
        i64 count = 0;
        i64 since = minus(t[i], window);
        for (i64 dy = 0; dy <= 2 * radius; ++dy) {
            Span<const i64> row = surface.part(place + dy * stride, place + dy * stride + 2 * radius + 1);
            for (i64 dx = 0; dx <= 2 * radius; ++dx)
                if (row[dx] >= since)
                    near[count++] = {i32(dx - radius), i32(dy - radius), double(minus(row[dx], t[i]))};
        }
        Plane plane{};
        Span<float> found = out[i];
        found[0] = found[1] = found[2] = 0;
        if (!fit_without_outliers(near.part(0, count), rules, plane) || std::abs(plane.at_center) > tolerance) return;
        double steepness = plane.by_x * plane.by_x + plane.by_y * plane.by_y;  // (µs per pixel)²
        // faster than times in µs can show
        if (steepness < 1) return;
        found[0] = float(1e6 * plane.by_x / steepness), found[1] = float(1e6 * plane.by_y / steepness), found[2] = 1;
    });
}

}  // namespace

void define_flow(nb::module_& module) { define<plane_flow>(module, "plane_flow"); }

}  // namespace nvsdata
