// Statistics of each pixel's events, and sums in patches of pixels.
#include "../native/bind.h"
#include "../native/levels.h"
#include "events.h"

namespace nvsdata {

namespace {

enum Quantity { COUNT, POLARITY, TIME };
enum Measure { SUM, MEAN, MAX, VARIANCE };

// Number of doubles that a measure needs per pixel: sum or maximum, number of events, sum of squares.
constexpr i64 needed(int measure) { return measure == VARIANCE ? 3 : measure == MEAN ? 2 : 1; }

template <int measure>
NVSDATA_INLINE void measure_pixels(const double* sums, i64 count, float* out) {
    for (i64 q = 0; q < count; ++q, sums += needed(measure)) {
        double events = measure == MEAN || measure == VARIANCE ? std::max(sums[1], 1.0) : 1.0, mean = sums[0] / events;
        double variance = measure == VARIANCE ? std::max(sums[2] / events - mean * mean, 0.0) : 0.0;
        out[q] = float(measure == VARIANCE ? variance : mean);
    }
}

void measured(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 start, i64 span,
              i64 first, i64 last, int wanted, int quantity, int measure, Array<double, 3> scratch, Rows<float> out) {
    Pixels events{x, y, p};
    require_columns(t.size(), events);
    require_shapes(scratch.shape == std::array<i64, 3>{3, out.rows(), out.columns()});
    if (first < 0 || last > t.size()) throw std::out_of_range("there are fewer events");
    Images images{out.columns(), out.rows()};
    Interrupt interrupt;
    double duration = double(span);
    // with constants as arguments, so that loops have no unneeded branches
    auto add = [&](auto kind, auto value_of) {
        constexpr int what = decltype(kind)::value;
        Span<double> sums = scratch.values.part(0, needed(what) * images.size);
        std::fill(sums.begin(), sums.end(), 0.0);
        each_event(images, events, first, last, interrupt, [&](i64 i, i64 place) {
            if (wanted >= 0 && p[i] != wanted) return;
            i64 at = needed(what) * place;
            double value = value_of(i);
            sums[at] = what == MAX ? std::max(sums[at], value) : sums[at] + value;
            if (what == MEAN || what == VARIANCE) sums[at + 1] += 1;
            if (what == VARIANCE) sums[at + 2] += value * value;
        });
        best<measure_pixels<what>>(static_cast<const double*>(sums.data()), images.size, out.data());
    };
    auto add_values = [&](auto kind) {
        if (quantity == COUNT)
            add(kind, [](i64) { return 1.0; });
        else if (quantity == POLARITY)
            add(kind, [&](i64 i) { return 2.0 * p[i] - 1; });
        else
            add(kind, [&](i64 i) { return span ? double(minus(t[i], start)) / duration : 0.0; });
    };
    if (measure == MEAN)
        add_values(std::integral_constant<int, MEAN>());
    else if (measure == MAX)
        add_values(std::integral_constant<int, MAX>());
    else if (measure == VARIANCE)
        add_values(std::integral_constant<int, VARIANCE>());
    else
        add_values(std::integral_constant<int, SUM>());
}

void tokens(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<const i64> bounds,
            i64 patch, Array<float, 6> out) {
    Pixels events{x, y, p};
    require_columns(t.size(), events);
    auto [parts, polarities, kinds, places, rows, columns] = out.shape;
    require(patch >= 1 && patch <= 32768, "patches must have a side, of at most 32,768 pixels");
    require_shapes(polarities == 2 && kinds == 2 && places == patch * patch);
    if (t.empty()) return;
    i64 start = t[0], size = places * rows * columns, patches = rows * columns, wide = columns;
    double scale = 1 / double(std::max<i64>(minus(t.back(), start), 1));
    u32 side = u32(patch);
    each_event_of_frames({columns * patch, rows * patch}, events, bounds, parts, [&](i64 part) {
        return [&, part](i64 i, i64) {
            u32 across = u32(x[i]) / side, down = u32(y[i]) / side;
            i64 place = i64(u32(y[i]) - down * side) * side + (u32(x[i]) - across * side);
            i64 cell = (part * 2 + p[i]) * 2 * size + place * patches + down * wide + across;
            out.values[cell] += 1;
            out.values[cell + size] += float(double(minus(t[i], start)) * scale);
        };
    });
}

}  // namespace

void define_measures(nb::module_& module) {
    define<measured>(module, "measured");
    define<tokens>(module, "tokens");
}

}  // namespace nvsdata
