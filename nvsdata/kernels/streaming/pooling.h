// Pooled features (maxima or means) that are updated incrementally, and the first fully connected layer.
#pragma once

#include "../native/require.h"
#include "convolution.h"

namespace nvsdata::streaming {

// Raise ValueError unless an output array fits.
inline void require_size(bool fits) { require(fits, "an array of another size is needed"); }

// Set the features of a node, and mark it if they changed.
inline void set_features(Features& features, i64 node, Span<const float> values) {
    Span<float> row = features.values[node];
    // NaN counts as a change
    if (std::equal(row.begin(), row.end(), values.begin())) return;
    if (!features.changed.has(node)) {
        std::copy(row.begin(), row.end(), features.before[node].begin());
        features.changed.mark(node);
    }
    std::copy(values.begin(), values.end(), row.begin());
}

// Update the features for another layer of the same graph from the rows that were computed.
inline void activate(const CellLayer& layer, Features& features) {
    std::vector<float> active(std::size_t(layer.out.columns()));
    for (i64 row : layer.rows) {
        Span<const float> out = layer.out[row];
        for (i64 c = 0; c < out.size(); ++c) active[c] = std::max(out[c], 0.0f);
        set_features(features, row, Span<const float>(active));
    }
}

constexpr unsigned OFTEN = 1 << 12;  // members between two polls for Ctrl-C

// Pools the rows below, before their activation, for the cells in `rescan`. O(members of these cells · channels).
class Pooling {
public:
    Pooling(bool is_average, i64 channels) : is_average_(is_average), pooled_(channels), sums_(channels) {}

    void update(Cells& cells, const Table<float>& below, Features& features, Interrupt& interrupt) {
        for (i64 cell : cells.rescan.numbers())
            if (cells.members[cell]) {
                is_average_ ? average(cells, cell, below, interrupt) : maximum(cells, cell, below, interrupt);
                set_features(features, cell, Span<const float>(pooled_));
            }
        cells.rescan.clear();
    }

private:
    bool is_average_;
    std::vector<float> pooled_;
    std::vector<double> sums_;
    unsigned members_ = 0;  // number of pooled members, modulo 2^32

    void maximum(const Cells& cells, i64 cell, const Table<float>& below, Interrupt& interrupt) {
        std::fill(pooled_.begin(), pooled_.end(), 0.0f);
        float* most = pooled_.data();
        each_member(cells, cell, below, interrupt, [&](const float* row, i64 channels) {
            for (i64 c = 0; c < channels; ++c) most[c] = std::max(most[c], row[c]);
        });
    }
    void average(const Cells& cells, i64 cell, const Table<float>& below, Interrupt& interrupt) {
        std::fill(sums_.begin(), sums_.end(), 0.0);
        double* sums = sums_.data();
        each_member(cells, cell, below, interrupt, [&](const float* row, i64 channels) {
            for (i64 c = 0; c < channels; ++c) sums[c] += std::max(row[c], 0.0f);
        });
        for (std::size_t c = 0; c < pooled_.size(); ++c) pooled_[c] = float(sums[c] / double(cells.members[cell]));
    }
    template <class Each>
    void each_member(const Cells& cells, i64 cell, const Table<float>& below, Interrupt& interrupt, Each each) {
        for (i64 node = cells.head[cell]; node >= 0; node = cells.after[cells.row_of(node)]) {
            if (++members_ % OFTEN == 0) interrupt.poll();
            each(below[cells.row_of(node)].data(), below.columns());
        }
    }
};

// The first fully connected layer, without its bias.
class Readout {
public:
    i64 products = 0;
    std::vector<double> sum;  // by hidden unit
    Table<float> shown;       // features to which the sums apply, by cell

    // `weight` has a row for each channel of each cell. A network without this layer has weights without columns.
    Readout(std::shared_ptr<const Table<float>> weight, i64 cells, i64 channels)
        : sum(std::size_t(weight->columns())), shown(cells, channels), weight_(std::move(weight)) {}

    void copy_sum(Span<double> out) const {
        require_size(out.size() == i64(sum.size()));
        std::copy(sum.begin(), sum.end(), out.begin());
    }
    void copy_shown(Rows<float> out) const {
        require_size(out.rows() == shown.rows() && out.columns() == shown.columns());
        for (i64 cell = 0; cell < out.rows(); ++cell)
            std::copy(shown[cell].begin(), shown[cell].end(), out[cell].begin());
    }

    // Set the features of a cell. O(changed features · hidden).
    void show(i64 cell, Span<const float> values);

    // Update from the features that changed.
    void update(const Cells& cells, Features& features) {
        std::vector<float> none(std::size_t(shown.columns()));
        for (const Marks* marks : {&std::as_const(cells.moved), &std::as_const(features.changed)})
            for (i64 cell : marks->numbers())
                show(cell, cells.members[cell] ? Span<const float>(features.values[cell]) : Span<const float>(none));
        features.changed.clear();
    }

private:
    std::shared_ptr<const Table<float>> weight_;
};

}  // namespace nvsdata::streaming
