// Corner events on the surfaces of active events: eFAST (Mueggler et al. 2017).
#include <array>

#include "../native/bind.h"
#include "events.h"

namespace nvsdata {

namespace {

struct Offset {
    i64 x, y;
};

// Pixels of two circles around an event, each in order.
constexpr std::array<Offset, 16> INNER{{{3, 0}, {3, 1}, {2, 2}, {1, 3}, {0, 3}, {-1, 3}, {-2, 2}, {-3, 1},
                                        {-3, 0}, {-3, -1}, {-2, -2}, {-1, -3}, {0, -3}, {1, -3}, {2, -2}, {3, -1}}};
constexpr std::array<Offset, 20> OUTER{{{4, 0}, {4, 1}, {3, 2}, {2, 3}, {1, 4}, {0, 4}, {-1, 4},
                                        {-2, 3}, {-3, 2}, {-4, 1}, {-4, 0}, {-4, -1}, {-3, -2}, {-2, -3},
                                        {-1, -4}, {0, -4}, {1, -4}, {2, -3}, {3, -2}, {4, -1}}};
constexpr i64 BORDER = 4;

// True if `shortest` to `longest` neighboring pixels of a circle are newer than all others.
//
// Such an arc consists of the newest pixels, so it grows from the newest one, at the end with the newer neighbor.
template <std::size_t n>
NVSDATA_INLINE bool has_newest_arc(const std::array<Offset, n>& circle, Span<const i64> surface, i64 place, i64 stride,
                                   i64 shortest, i64 longest) {
    std::array<i64, n> times;
    for (std::size_t k = 0; k < n; ++k) times[k] = surface[place + circle[k].y * stride + circle[k].x];
    std::size_t newest = 0;
    for (std::size_t k = 1; k < n; ++k)
        if (times[k] > times[newest]) newest = k;
    std::size_t left = (newest + n - 1) % n, right = (newest + 1) % n;  // the neighbors of the arc
    i64 oldest = times[newest];
    for (i64 length = 2; length <= longest; ++length) {
        bool to_left = times[left] > times[right];
        oldest = std::min(oldest, times[to_left ? left : right]);
        if (to_left)
            left = (left + n - 1) % n;
        else
            right = (right + 1) % n;
        if (length < shortest) continue;
        i64 count = 0;
        for (i64 time : times) count += time >= oldest;
        if (count == length) return true;
    }
    return false;
}

void corners(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Array<i64, 3> latest,
             Span<bool> keep) {
    Pixels events{x, y, p, Polarity::off_first};
    require_columns(t.size(), events);
    auto [polarities, height, width] = latest.shape;
    require_shapes(polarities == 2 && keep.size() == t.size());
    Images images{width, height};
    Span<i64> surface = latest.values;
    each_event(images, events, [&, height = height, width = width](i64 i, i64 place) {
        surface[place] = t[i];
        keep[i] = x[i] >= BORDER && y[i] >= BORDER && x[i] < width - BORDER && y[i] < height - BORDER &&
                  has_newest_arc(INNER, surface, place, width, 3, 6) &&
                  has_newest_arc(OUTER, surface, place, width, 4, 8);
    });
}

}  // namespace

void define_corners(nb::module_& module) { define<corners>(module, "corners"); }

}  // namespace nvsdata
