// B-spline convolutions of changing graphs.
#include "convolution.h"

#include "../graph/edges.h"
#include "../native/levels.h"

namespace nvsdata::streaming {

namespace {

constexpr i64 INPUTS = 16;  // inputs whose weights are used for all targets while they are in the cache

// Sum of products added to `sum`, in order.
inline void add_products(float* __restrict sum, const float* value, const float* const* weight, i64 count,
                         i64 channels) {
    i64 n = 0;
    for (; n + 4 <= count; n += 4) {
        float a = value[n], b = value[n + 1], c = value[n + 2], d = value[n + 3];
        const float *wa = weight[n], *wb = weight[n + 1], *wc = weight[n + 2], *wd = weight[n + 3];
        for (i64 o = 0; o < channels; ++o) sum[o] = sum[o] + a * wa[o] + b * wb[o] + c * wc[o] + d * wd[o];
    }
    for (; n < count; ++n) {
        float a = value[n];
        const float* wa = weight[n];
        for (i64 o = 0; o < channels; ++o) sum[o] += a * wa[o];
    }
}

// Add products of the values that aren't zero, which are set to zero; returns their number.
NVSDATA_INLINE i64 multiply_row(float* __restrict values, const float* weights, i64 inputs, i64 channels,
                                     float* sum) {
    float value[INPUTS];
    const float* weight[INPUTS];
    i64 count = 0;
    for (i64 c = 0; c < inputs; ++c) {
        value[count] = values[c];
        weight[count] = weights + c * channels;
        count += values[c] != 0;
        values[c] = 0;
    }
    add_products(sum, value, weight, count, channels);
    return count;
}

NVSDATA_INLINE void add_scaled(float* __restrict sum, const float* features, const float* less, float part,
                                    i64 channels) {
    if (less)
        for (i64 c = 0; c < channels; ++c) sum[c] += part * (features[c] - less[c]);
    else
        for (i64 c = 0; c < channels; ++c) sum[c] += part * features[c];
}

// Add products over the edges, then of the node itself, to the sums, and set them to 0.
NVSDATA_INLINE void collect_row(double* __restrict edges, double* __restrict self, float* __restrict product,
                                     float* __restrict out, double share, i64 channels) {
    for (i64 o = 0; o < channels; ++o) {
        edges[o] += product[o];
        self[o] += product[channels + o];
        out[o] = float(edges[o] * share + self[o]);
        product[o] = product[channels + o] = 0;
    }
}

struct Between {
    i64 lower;    // the lower of the two kernel cells along an axis
    float upper;  // weight of the upper one
};

// Computed in float32, as in batches.
Between place(const Kernel& kernel, std::size_t axis, i64 difference) {
    float d = float(difference) / kernel.reach[axis];
    float v = pseudo_coordinate(d, kernel.is_signed) * float(kernel.size - 1);
    i64 lower = std::min(i64(v), kernel.size - 2);
    return {lower, v - float(lower)};
}

}  // namespace

void Convolution::add_to(i64 at, i64 cell, Span<const float> features, Span<const float> less, float part) {
    used_(at, cell) = 1;
    best<add_scaled>(share_[at * (kernel_->cells + 1) + cell].data(), features.data(), less.data(), part, kernel_->in);
}

void Convolution::add(i64 at, Span<const float> features, Span<const float> less, const Place& away, float way) {
    const Kernel& kernel = *kernel_;
    if (kernel.size == 1) return add_to(at, 0, features, less, way);
    auto [i, u] = place(kernel, 0, away.x);
    auto [j, v] = place(kernel, 1, away.y);
    auto [k, w] = kernel.reach.size() > 2 ? place(kernel, 2, away.t) : Between{0, 0};
    for (int corner = 0; corner < (kernel.reach.size() > 2 ? 8 : 4); ++corner) {
        int a = corner & 1, b = corner >> 1 & 1, c = corner >> 2;
        float part = (a ? u : 1 - u) * (b ? v : 1 - v) * (c ? w : 1 - w);
        if (part != 0) add_to(at, i + a + kernel.size * (j + b + kernel.size * (k + c)), features, less, way * part);
    }
}

void Convolution::multiply(i64 targets) {
    const Kernel& kernel = *kernel_;
    for (i64 cell = 0; cell <= kernel.cells; ++cell) {
        i64 users[TOGETHER], count = 0;
        for (i64 at = 0; at < targets; ++at)
            if (std::exchange(used_(at, cell), 0)) users[count++] = at;
        for (i64 first = 0; count && first < kernel.in; first += INPUTS) {
            const float* weights = kernel.weight[cell * kernel.in + first].data();
            i64 inputs = std::min(INPUTS, kernel.in - first);
            for (i64 n = 0; n < count; ++n) {
                float* values = share_[users[n] * (kernel.cells + 1) + cell].data() + first;
                float* sum = product_[users[n]].data() + (cell == kernel.cells ? kernel.out : 0);
                products += kernel.out * best<multiply_row>(values, weights, inputs, kernel.out, sum);
            }
        }
    }
}

void Convolution::collect(i64 at, i64 degree, Span<double> edges, Span<double> self, Span<float> out) {
    double share = degree ? 1.0 / double(degree) : 0.0;
    best<collect_row>(edges.data(), self.data(), product_[at].data(), out.data(), share, kernel_->out);
}

void convolve(Convolution& layer, const Window& window, const Table<float>& features, Span<const i64> rows,
              Table<float>& out, Interrupt& interrupt) {
    const Kernel& kernel = layer.kernel();
    std::vector<double> edges(std::size_t(kernel.out)), self(edges);
    for (i64 start = 0; start < rows.size(); start += TOGETHER) {
        interrupt.poll();
        Span<const i64> some = rows.part(start, std::min(start + TOGETHER, rows.size()));
        for (i64 at = 0; at < some.size(); ++at) {
            i64 row = some[at];
            for (i32 n = 0; n < window.degree[row]; ++n) {
                i64 other = window.row_of(window.source(row, n));
                layer.add(at, features[other], {}, window.place(other) - window.place(row), 1);
            }
            layer.add_self(at, features[row], {});
        }
        layer.multiply(some.size());
        for (i64 at = 0; at < some.size(); ++at) {
            std::fill(edges.begin(), edges.end(), 0.0);
            std::copy(kernel.bias.begin(), kernel.bias.end(), self.begin());
            layer.collect(at, window.degree[some[at]] + kernel.loops, edges, self, out[some[at]]);
        }
    }
}

void CellLayer::update(const Cells& cells, Features& features, Interrupt& interrupt) {
    mark_targets(cells, features);
    dirty_.drain(rows, [&](i64 cell) { return cells.members[cell] > 0; });
    i64 degree[TOGETHER], count = i64(rows.size());
    for (i64 start = 0; start < count; start += TOGETHER) {
        interrupt.poll();
        Span<i64> some = Span<i64>(rows).part(start, std::min(start + TOGETHER, count));
        for (i64 at = 0; at < some.size(); ++at) degree[at] = sum_up(cells, features, at, some[at]);
        convolution_.multiply(some.size());
        for (i64 at = 0; at < some.size(); ++at)
            convolution_.collect(at, degree[at], edges_[some[at]], self_[some[at]], out[some[at]]);
    }
    features.changed.clear();
}

// Mark the nodes whose rows may change.
void CellLayer::mark_targets(const Cells& cells, const Features& features) {
    for (const Marks* marks : {&cells.moved, &features.changed})
        for (i64 cell : marks->numbers()) {
            dirty_.mark(cell);
            cells.around(cell, [&](i64 offset, i64 other) {
                if (cells.edge(other, cells.opposite(offset))) dirty_.mark(other);
            });
        }
    for (i64 number : cells.turned.numbers()) dirty_.mark(number / cells.offsets);
}

// Sum the edges of a node: all edges if it moved or most of them changed, otherwise only the differences. Returns the
// number of edges.
i64 CellLayer::sum_up(const Cells& cells, const Features& features, i64 at, i64 cell) {
    const Kernel& kernel = convolution_.kernel();
    const Marks &changed = features.changed, &moved = cells.moved;
    // in halves, assuming that half of the channels of changed features changed
    i64 degree = kernel.loops, different = changed.has(cell);
    cells.around(cell, [&](i64 offset, i64 source) {
        bool now = cells.edge(cell, offset);
        degree += now;
        if (cells.turned.has(cell * cells.offsets + offset))
            different += 2;
        else if (now)
            // the old value is subtracted and the new one added, or only the difference is added
            different += moved.has(source) ? 4 : changed.has(source);
    });
    bool is_whole = moved.has(cell) || different > 2 * degree || age_[cell] >= OLD;
    ++age_[cell];
    Span<const float> none;
    if (is_whole) {
        for (double& sum : edges_[cell]) sum = 0;
        std::copy(kernel.bias.begin(), kernel.bias.end(), self_[cell].begin());
        age_[cell] = 0;
        convolution_.add_self(at, features.values[cell], none);
    } else if (changed.has(cell)) {
        convolution_.add_self(at, features.values[cell], features.before[cell]);
    }
    cells.around(cell, [&](i64 offset, i64 source) {
        bool now = cells.edge(cell, offset), turned = cells.turned.has(cell * cells.offsets + offset);
        bool has_moved = moved.has(source), has_changed = changed.has(source);
        if (!(now || turned) || !(is_whole || turned || has_moved || has_changed)) return;
        // its earlier contribution must be subtracted, because the edge is removed, changed or moved
        bool less = !is_whole && now != turned;
        Place here = cells.place[cell], away = cells.place[source] - here;
        Span<const float> values = features.values[source], before = features.before[source];
        if (now && less && !has_moved) return convolution_.add(at, values, before, away, 1);
        if (now) convolution_.add(at, values, none, away, 1);
        if (!less) return;
        convolution_.add(at, has_changed ? before : values, none, has_moved ? cells.was[source] - here : away, -1);
    });
    return degree;
}

}  // namespace nvsdata::streaming
