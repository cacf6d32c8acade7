// Events of pixels: merged into nodes, and counted around nodes.
#include <cmath>
#include <numeric>
#include <vector>

#include "../native/bind.h"
#include "events.h"

namespace nvsdata {

namespace {

constexpr i64 SIDE = 8, CELLS = SIDE * SIDE;  // of a tile of pixels

// A value per pixel, at first 0, in tiles, so that memory grows with the number of events.
template <class Value>
class Tiles {
public:
    Tiles(Span<const i16> x, Span<const i16> y) {
        if (x.empty()) return;
        auto [left, right] = std::minmax_element(x.begin(), x.end());
        auto [top, bottom] = std::minmax_element(y.begin(), y.end());
        left_ = *left, top_ = *top;
        columns_ = (*right - left_) / SIDE + 1, rows_ = (*bottom - top_) / SIDE + 1;
        tiles_.resize(std::size_t(columns_ * rows_));
    }
    // The value of the pixel of an event, which must be in the box around all events.
    Value& of_event(i16 x, i16 y) {
        u32 column = u32(x - left_), row = u32(y - top_);
        i32& tile = Span<i32>(tiles_)[row / SIDE * columns_ + column / SIDE];
        if (tile == 0) {
            values_.resize(values_.size() + CELLS);
            tile = i32(values_.size() / CELLS);
        }
        return Span<Value>(values_)[(tile - 1) * CELLS + row % SIDE * SIDE + column % SIDE];
    }
    // Calls each(i, value) for the pixels (x + i, y) of a row, if they are in tiles that have events.
    template <class Each>
    void each_of_row(i64 x, i64 y, i64 count, Each each) const {
        i64 row = y - top_, column = x - left_;
        if (row < 0 || row >= rows_ * SIDE) return;
        Span<const Value> values(values_);
        Span<const i32> tiles = Span<const i32>(tiles_).part(row / SIDE * columns_, (row / SIDE + 1) * columns_);
        for (i64 i = std::max<i64>(-column, 0); i < std::min(count, columns_ * SIDE - column); ++i) {
            u32 at = u32(column + i);
            if (i32 tile = tiles[at / SIDE]) each(i, values[(tile - 1) * CELLS + row % SIDE * SIDE + at % SIDE]);
        }
    }

private:
    i64 left_ = 0, top_ = 0, columns_ = 0, rows_ = 0;
    std::vector<i32> tiles_;  // number of the values of each tile, from 1 on, or 0
    std::vector<Value> values_;
};

struct Node {
    i64 first, last, total, events;  // times, and the sum of times since the first
    float counts[2];                 // numbers of events of polarity 1 and 0
    i16 x, y;
    i64 mean() const { return plus(first, floor_divide(total, events)); }
};

i64 merged_pixels(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Rows<float> pos,
                  Span<i64> time, Rows<i64> ends, Rows<float> counts) {
    i64 n = t.size();
    require_columns(n, {x, y, p});
    require(n <= std::numeric_limits<i32>::max(), "at most 2^31 - 1 events can be merged");
    require_shapes(pos.rows() == n && pos.columns() == 2 && time.size() == n && ends.rows() == n &&
                   ends.columns() == 2 && counts.rows() == n && counts.columns() == 2);
    Tiles<i32> numbers(x, y);  // numbers of nodes, from 1 on
    std::vector<Node> nodes;
    Interrupt interrupt;
    for (i64 i = 0; i < n; ++i) {
        i32& number = numbers.of_event(x[i], y[i]);
        if (number == 0) {
            nodes.push_back({t[i], t[i], 0, 0, {0, 0}, x[i], y[i]});
            number = i32(nodes.size());
        }
        Node& node = Span<Node>(nodes)[number - 1];
        // times since the first one, because a sum of absolute times may overflow
        node.total = plus(node.total, minus(t[i], node.first));
        node.last = t[i];
        ++node.events;
        node.counts[p[i] == 0] += 1;
        if (i % STEPS == 0) interrupt.poll();
    }
    // ties of the mean: the pixel that fired first
    std::vector<std::pair<i64, i32>> by_time;
    for (const Node& node : nodes) by_time.emplace_back(node.mean(), i32(by_time.size()));
    std::sort(by_time.begin(), by_time.end());
    i64 m = 0;
    for (auto [mean, number] : by_time) {
        const Node& node = Span<Node>(nodes)[number];
        pos(m, 0) = node.x, pos(m, 1) = node.y;
        time[m] = mean;
        ends(m, 0) = node.first, ends(m, 1) = node.last;
        counts(m, 0) = node.counts[0], counts(m, 1) = node.counts[1];
        ++m;
    }
    return m;
}

// The pixel nearest to a node, along an axis; for NaN and the like, one that is far away.
i64 pixel_of(float place) {
    double pixel = std::floor(double(place) + 0.5);
    return std::abs(pixel) < 1e6 ? i64(pixel) : i64(1) << 32;
}

void patch_counts(Span<const i16> x, Span<const i16> y, Span<const u8> p, Rows<const float> pos, Array<float, 4> out) {
    require_columns(x.size(), {x, y, p});
    i64 size = out.shape[2], half = size / 2;
    require(x.size() <= std::numeric_limits<i32>::max(), "at most 2^31 - 1 events can be counted");
    require_shapes(pos.columns() == 2 && out.shape == std::array<i64, 4>{pos.rows(), 2, size, size});
    struct Counts {
        float of[2];  // polarity 1 and 0
    };
    Tiles<Counts> counts(x, y);
    Interrupt interrupt;
    for (i64 i = 0; i < x.size(); ++i) {
        counts.of_event(x[i], y[i]).of[p[i] == 0] += 1;
        if (i % STEPS == 0) interrupt.poll();
    }
    i64 patch = size * size;
    for (i64 node = 0; node < pos.rows(); ++node) {
        i64 left = pixel_of(pos(node, 0)) - half, top = pixel_of(pos(node, 1)) - half;
        Span<float> on = out.values.part(2 * node * patch, (2 * node + 1) * patch);
        Span<float> off = out.values.part((2 * node + 1) * patch, (2 * node + 2) * patch);
        for (i64 row = 0; row < size; ++row)
            counts.each_of_row(left, top + row, size, [&](i64 i, const Counts& found) {
                on[row * size + i] = found.of[0];
                off[row * size + i] = found.of[1];
            });
        if (node % 64 == 0) interrupt.poll();
    }
}

}  // namespace

void define_patches(nb::module_& module) {
    define<merged_pixels>(module, "merged_pixels");
    define<patch_counts>(module, "patch_counts");
}

}  // namespace nvsdata
