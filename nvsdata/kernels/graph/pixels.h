// Events grouped by pixel, and the pixels near a pixel that have events.
#pragma once

#include <algorithm>
#include <numeric>

#include "../native/span.h"
#include "../native/steps.h"
#include "../native/vector.h"

namespace nvsdata {

constexpr i64 FAR = i64(1) << 40;  // squared pixels: more than between any two pixels
constexpr i64 LISTED = 8;          // pixels up to which the offsets of neighbors are listed, nearest first
constexpr i64 SPACIOUS = 64;        // places per event up to which a map of all places is made

// Offsets of squared length up to `furthest`, nearest first; rings of equal length.
struct Offsets {
    Vector<i64> steps;   // to the neighbor's place in the map
    Vector<i64> begins;  // first offset of each ring, and their number at the end
    Vector<i64> lengths; // squared, of each ring

    Offsets(i64 furthest, i64 columns) {
        i64 reach = 0;
        while ((reach + 1) * (reach + 1) <= furthest) ++reach;
        for (const Step& step : steps_around(reach, [&](i64 square) { return square <= furthest; })) {
            if (lengths.empty() || lengths.back() != step.square) {
                begins.push_back(i64(steps.size()));
                lengths.push_back(step.square);
            }
            steps.push_back(step.dy * columns + step.dx);
        }
        begins.push_back(i64(steps.size()));
    }
};

struct Near {
    i64 apart;  // squared pixels
    i32 pixel;
    bool operator<(const Near& other) const {
        return apart < other.apart || (apart == other.apart && pixel < other.pixel);
    }
};

// The pixels with events, row by row, of at least one event. O(N), or O(N log N) if the events are far apart.
struct PixelLists {
    Vector<i32> order, first;  // events pixel by pixel, in order within a pixel; first event of each pixel
    Vector<i32> x, y;          // pixels, from the corner of the box around all events with a margin of LISTED pixels
    Vector<i32> map;           // number of the pixel at each place of that box, or -1; empty if it would be large
    Vector<i32> row, begins;   // rows with pixels, and the first pixel of each row
    Vector<i32> row_of;        // index of the row of each pixel
    i64 columns = 0;

    template <class Coordinate>
    PixelLists(Span<const Coordinate> xs, Span<const Coordinate> ys, bool apart) {
        std::size_t n = xs.size();
        // if `apart` is false, all events are treated as if at one pixel
        i64 left = 0, top = 0, right = 0, bottom = 0;
        if (apart) {
            auto [x0, x1] = std::minmax_element(xs.begin(), xs.end());
            auto [y0, y1] = std::minmax_element(ys.begin(), ys.end());
            left = *x0, right = *x1, top = *y0, bottom = *y1;
        }
        columns = right - left + 1 + 2 * LISTED;
        i64 places = columns * (bottom - top + 1 + 2 * LISTED);
        auto place = [&](std::size_t i) {
            return apart ? (ys[i] - top + LISTED) * columns + xs[i] - left + LISTED : LISTED * columns + LISTED;
        };
        order.resize(n);
        if (places <= SPACIOUS * i64(n + 512)) {
            map.assign(places, 0);
            for (std::size_t i = 0; i < n; ++i) ++map[place(i)];
            i32 begin = 0;
            Vector<i32> next;
            for (i64 at = 0; at < places; ++at) {
                i32 count = map[at];
                map[at] = count ? add(at, begin) : -1;
                begin += count;
            }
            next = first;
            for (std::size_t i = 0; i < n; ++i) order[next[map[place(i)]]++] = i32(i);
        } else {
            std::iota(order.begin(), order.end(), 0);
            Vector<i64> places_of(n);
            for (std::size_t i = 0; i < n; ++i) places_of[i] = place(i);
            std::stable_sort(order.begin(), order.end(), [&](i32 a, i32 b) { return places_of[a] < places_of[b]; });
            for (std::size_t e = 0; e < n; ++e)
                if (e == 0 || places_of[order[e]] != places_of[order[e - 1]]) add(places_of[order[e]], i32(e));
        }
        first.push_back(i32(n));
        begins.push_back(i32(x.size()));
    }

    std::size_t size() const { return x.size(); }
    i64 events(i32 pixel) const { return first[pixel + 1] - first[pixel]; }

    // The pixels around a pixel, including it, nearest first and at most at `furthest`; returns the number of their
    // events. If the pixels up to some distance have `enough` events, pixels farther than this distance plus `blur` are
    // left out.
    i64 near(i32 pixel, i64 enough, i64 furthest, i64 blur, const Offsets& offsets, Vector<Near>& found) const {
        found.clear();
        return map.empty() || furthest > LISTED * LISTED ? outward(pixel, enough, furthest, blur, found)
                                                         : listed(pixel, enough, furthest, blur, offsets, found);
    }

private:
    i32 add(i64 at, i32 begin) {
        i32 pixel = i32(x.size()), here = i32(at / columns);
        x.push_back(i32(at - here * columns));
        y.push_back(here);
        first.push_back(begin);
        if (row.empty() || row.back() != here) {
            row.push_back(here);
            begins.push_back(pixel);
        }
        row_of.push_back(i32(row.size()) - 1);
        return pixel;
    }

    i64 listed(i32 pixel, i64 enough, i64 furthest, i64 blur, const Offsets& offsets, Vector<Near>& found) const {
        const i32* here = map.data() + y[pixel] * columns + x[pixel];
        i64 total = 0, bound = furthest;
        std::size_t m = 0;
        found.resize(offsets.steps.size() + 1);
        for (std::size_t ring = 0; ring < offsets.lengths.size() && offsets.lengths[ring] <= bound; ++ring) {
            std::size_t before = m;
            // without branches, because it is unpredictable which pixels have events
            for (i64 o = offsets.begins[ring]; o < offsets.begins[ring + 1]; ++o) {
                i32 q = here[offsets.steps[o]];
                found[m] = {offsets.lengths[ring], q};
                m += q >= 0;
            }
            for (std::size_t q = before; q < m; ++q) total += events(found[q].pixel);
            if (total >= enough) bound = std::min(bound, offsets.lengths[ring] + blur);
        }
        found.resize(m);
        return total;
    }

    // Searches row by row, and pixel by pixel within a row, the nearest first.
    i64 outward(i32 pixel, i64 enough, i64 furthest, i64 blur, Vector<Near>& found) const {
        i64 total = 0, bound = furthest;
        std::size_t full = 0;
        auto cut = [&] {
            std::sort(found.begin(), found.end());
            i64 have = 0;
            std::size_t m = 0;
            for (; m < found.size() && found[m].apart <= bound; ++m) {
                if (have < enough && (have += events(found[m].pixel)) >= enough)
                    bound = std::min(bound, found[m].apart + blur);
            }
            for (std::size_t q = m; q < found.size(); ++q) total -= events(found[q].pixel);
            found.resize(m);
            full = 2 * m;
        };
        auto take = [&](i32 q, i64 d) {
            found.push_back({d, q});
            total += events(q);
            if (total >= enough && found.size() >= full) cut();
        };
        auto along = [&](i32 r) {
            i64 dy = row[r] - y[pixel];
            auto begin = x.begin() + begins[r], end = x.begin() + begins[r + 1];
            auto after = std::lower_bound(begin, end, x[pixel]), before = after;
            while (before != begin || after != end) {
                i64 ahead = after != end ? *after - x[pixel] : FAR;
                i64 behind = before != begin ? x[pixel] - before[-1] : FAR;
                i64 dx = std::min(ahead, behind);
                if (dx * dx + dy * dy > bound) return;
                take(i32((ahead <= behind ? after++ : --before) - x.begin()), dx * dx + dy * dy);
            }
        };
        along(row_of[pixel]);
        i32 up = row_of[pixel] - 1, down = row_of[pixel] + 1, rows = i32(row.size());
        while (up >= 0 || down < rows) {
            i64 above = up >= 0 ? y[pixel] - row[up] : FAR, below = down < rows ? row[down] - y[pixel] : FAR;
            i64 dy = std::min(above, below);
            if (dy * dy > bound) break;
            along(above <= below ? up-- : down++);
        }
        cut();
        return total;
    }
};

}  // namespace nvsdata
