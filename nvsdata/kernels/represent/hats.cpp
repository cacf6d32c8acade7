// Histograms of averaged time surfaces (Sironi et al. 2018).
#include <vector>

#include "../native/bind.h"
#include "epochs.h"

namespace nvsdata {

namespace {

// For each pixel and polarity, the sum of the exponentials of its events in the window, and its epoch.
struct Sums {
    Span<double> values;
    Span<i64> epochs, members;
    const Epochs& clock;

    void enter(i64 place, double value, i64 epoch) const {
        values[place] = values[place] * clock.faded(minus(epoch, epochs[place])) + value;
        epochs[place] = epoch;
        ++members[place];
    }
    void leave(i64 place, double value, i64 epoch) const {
        --members[place];
        // the oldest value is the smallest, so rounding errors are small; without members the sum is exactly 0
        values[place] = members[place] ? values[place] - value * clock.faded(minus(epochs[place], epoch)) : 0.0;
    }
};

struct Entry {
    double value;
    i64 epoch, place;
};

void sum_surfaces(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 cell, i64 radius,
                  i64 window, double tau, Array<double, 3> sums, Array<i64, 3> epochs, Array<i64, 3> members,
                  Array<double, 4> out, Span<i64> counts) {
    Pixels events{x, y, p, Polarity::on_first};
    require_columns(t.size(), events);
    require(cell >= 1 && cell <= 32768 && radius >= 0 && radius <= 32768, "cell must be at least 1, radius at least 0");
    i64 height = sums.shape[1], width = sums.shape[2];
    i64 rows = (height + cell - 1) / cell, columns = (width + cell - 1) / cell;
    i64 side = 2 * radius + 1, around = side * side;
    require_shapes(sums.shape[0] == 2 && epochs.shape == sums.shape && members.shape == sums.shape &&
                   counts.size() == rows * columns && out.shape == std::array<i64, 4>{counts.size(), 2, side, side});
    Images images{width, height};
    Epochs clock(tau);
    Sums kept{sums.values, epochs.values, members.values, clock};
    std::vector<Entry> seen(t.size());
    Span<Entry> entries(seen);
    i64 entered = 0, left = 0;
    each_event(images, events, [&](i64 i, i64 place) {
        i64 since = minus(t[i], t[0]), epoch = clock.of(since);
        double value = clock.value(since, epoch);
        entries[i] = {value, epoch, place};
        // events of the same time are added later
        for (; entered < i && t[entered] < t[i]; ++entered)
            kept.enter(entries[entered].place, entries[entered].value, entries[entered].epoch);
        for (; left < entered && minus(t[i], t[left]) > window; ++left)
            kept.leave(entries[left].place, entries[left].value, entries[left].epoch);
        i64 row = u32(y[i]) / u32(cell), column = u32(x[i]) / u32(cell), home = row * columns + column;
        ++counts[home];
        i64 y0 = std::max(y[i] - radius, row * cell), y1 = std::min({y[i] + radius + 1, (row + 1) * cell, height});
        i64 x0 = std::max(x[i] - radius, column * cell), x1 = std::min({x[i] + radius + 1, (column + 1) * cell, width});
        i64 channel = 1 - p[i];
        double shrink = 1 / value;
        for (i64 r = y0; r < y1; ++r) {
            i64 from = (channel * height + r) * width;
            i64 to = (home * 2 + channel) * around + (r - y[i] + radius) * side - x[i] + radius;
            for (i64 c = x0; c < x1; ++c) {
                double near = kept.values[from + c];
                // usually there is no event
                if (near != 0) out.values[to + c] += near * clock.faded(minus(epoch, kept.epochs[from + c])) * shrink;
            }
        }
    });
}

}  // namespace

void define_hats(nb::module_& module) { define<sum_surfaces>(module, "sum_surfaces"); }

}  // namespace nvsdata
