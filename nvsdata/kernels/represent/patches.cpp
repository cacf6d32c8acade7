// Events of pixels: merged into nodes, and counted around nodes.
#include <cmath>
#include <numeric>
#include <vector>

#include "../native/bind.h"
#include "events.h"

namespace nvsdata {

namespace {

// Numbers of the pixels that have events, in the order of their first ones; in tiles of 8 x 8 pixels, so that memory
// grows with the events.
class Numbers {
public:
    Numbers(Span<const i16> x, Span<const i16> y) {
        if (x.empty()) return;
        auto [left, right] = std::minmax_element(x.begin(), x.end());
        auto [top, bottom] = std::minmax_element(y.begin(), y.end());
        left_ = *left, top_ = *top;
        columns_ = (*right - left_) / 8 + 1, rows_ = (*bottom - top_) / 8 + 1;
        tiles_.resize(std::size_t(rows_ * columns_));
    }
    i64 count() const { return count_; }
    // Of a pixel that has events.
    i32 of_event(i16 x, i16 y) {
        i32& number = place(x - left_, y - top_);
        if (number < 0) number = count_++;
        return number;
    }
    // -1 for pixels without events.
    i32 at(i64 x, i64 y) const {
        u64 column = u64(x - left_), row = u64(y - top_);
        if (column >= u64(columns_) * 8 || row >= u64(rows_) * 8) return -1;
        i32 tile = tiles_[(row / 8) * u64(columns_) + column / 8];
        return tile ? numbers_[u64(tile - 1) * 64 + row % 8 * 8 + column % 8] : -1;
    }

private:
    i64 left_ = 0, top_ = 0, columns_ = 0, rows_ = 0;
    i32 count_ = 0;
    std::vector<i32> tiles_;    // one more than the tile's place among those that have events, 0 for others
    std::vector<i32> numbers_;  // of the tiles' pixels

    // Pixels are within the box around all events.
    i32& place(u32 column, u32 row) {
        i32& tile = Span<i32>(tiles_)[i64(row / 8) * columns_ + column / 8];
        if (!tile) {
            numbers_.resize(numbers_.size() + 64, -1);
            tile = i32(numbers_.size() / 64);
        }
        return Span<i32>(numbers_)[i64(tile - 1) * 64 + row % 8 * 8 + column % 8];
    }
};

struct Node {
    i64 first, last, total, events;  // times, and the sum of times since the first
    float counts[2];                 // of polarity 1 and 0
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
    Numbers numbers(x, y);
    std::vector<Node> nodes;
    Interrupt interrupt;
    for (i64 i = 0; i < n; ++i) {
        std::size_t number = std::size_t(numbers.of_event(x[i], y[i]));
        if (number == nodes.size()) nodes.push_back({t[i], t[i], 0, 0, {0, 0}, x[i], y[i]});
        Node& node = nodes[number];
        // from the first time on, because a sum of absolute times may be too large
        node.total = plus(node.total, minus(t[i], node.first));
        node.last = t[i];
        ++node.events;
        node.counts[p[i] == 0] += 1;
        if (i % STEPS == 0) interrupt.poll();
    }
    // of equal means the pixel that fired first
    std::vector<std::pair<i64, i32>> by_time;
    for (const Node& node : nodes) by_time.emplace_back(node.mean(), i32(by_time.size()));
    std::sort(by_time.begin(), by_time.end());
    i64 m = 0;
    for (auto [mean, number] : by_time) {
        const Node& node = nodes[std::size_t(number)];
        pos(m, 0) = node.x, pos(m, 1) = node.y;
        time[m] = mean;
        ends(m, 0) = node.first, ends(m, 1) = node.last;
        counts(m, 0) = node.counts[0], counts(m, 1) = node.counts[1];
        ++m;
    }
    return m;
}

// The pixel that a node is nearest to, along an axis; far away for what is no pixel.
i64 pixel_of(float place) {
    double pixel = std::floor(double(place) + 0.5);
    return std::abs(pixel) < 1e6 ? i64(pixel) : i64(1) << 32;
}

void patch_counts(Span<const i16> x, Span<const i16> y, Span<const u8> p, Rows<const float> pos, Array<float, 4> out) {
    require_columns(x.size(), {x, y, p});
    i64 size = out.shape[2], half = size / 2;
    require(x.size() <= std::numeric_limits<i32>::max(), "at most 2^31 - 1 events can be counted");
    require_shapes(pos.columns() == 2 && out.shape == std::array<i64, 4>{pos.rows(), 2, size, size});
    Numbers numbers(x, y);
    std::vector<std::array<float, 2>> counts;
    Interrupt interrupt;
    for (i64 i = 0; i < x.size(); ++i) {
        std::size_t number = std::size_t(numbers.of_event(x[i], y[i]));
        if (number == counts.size()) counts.push_back({0, 0});
        counts[number][p[i] == 0] += 1;
        if (i % STEPS == 0) interrupt.poll();
    }
    for (i64 node = 0; node < pos.rows(); ++node) {
        i64 left = pixel_of(pos(node, 0)) - half, top = pixel_of(pos(node, 1)) - half;
        Span<float> on = out.values.part(2 * node * size * size, (2 * node + 1) * size * size);
        Span<float> off = out.values.part((2 * node + 1) * size * size, (2 * node + 2) * size * size);
        for (i64 b = 0; b < size; ++b)
            for (i64 a = 0; a < size; ++a) {
                i32 number = numbers.at(left + a, top + b);
                if (number < 0) continue;
                on[b * size + a] = counts[std::size_t(number)][0];
                off[b * size + a] = counts[std::size_t(number)][1];
            }
        if (node % 64 == 0) interrupt.poll();
    }
}

}  // namespace

void define_patches(nb::module_& module) {
    define<merged_pixels>(module, "merged_pixels");
    define<patch_counts>(module, "patch_counts");
}

}  // namespace nvsdata
