// B-spline aggregation: each edge adds shares of its source's features to the kernel cells of its target.
#include <algorithm>
#include <vector>

#include "../native/bind.h"
#include "../native/interrupt.h"

namespace nvsdata {

namespace {

constexpr i64 TOGETHER = 128;  // edges whose shares are computed together
constexpr i64 PATIENCE = 64;   // such groups between two looks for Ctrl-C

// Edges grouped by target, with pseudo-coordinates in 0..1, and the number of a kernel's cells along each axis.
template <class Float>
struct Edges {
    Span<const i64> source, target;
    Rows<const Float> u;
    i64 size, nodes;
};

// Of some edges the kernel cells at the 2^D corners around each, and its shares of them, for B-splines of degree 1.
template <class Float>
class Shares {
public:
    explicit Shares(const Edges<Float>& edges)
        : edges_(edges), row_(TOGETHER), first_(TOGETHER), low_(TOGETHER), high_(TOGETHER), members_(TOGETHER), steps_(1) {
        // a kernel of one cell has no corners; of others there is an array of size^D cells, so D is small
        axes_ = edges.size > 1 ? edges.u.columns() : 0;
        for (i64 axis = 0, stride = 1; axis < axes_; ++axis, stride *= edges.size)
            for (i64 corner = 0; corner < i64(1) << axis; ++corner) steps_.push_back(steps_[corner] + stride);
        shares_.resize(steps_.size() * TOGETHER);
    }

    // The share of each corner, divided by the number of the target's edges; 0 where an edge doesn't touch it.
    Span<Float> of(i64 corner) { return {shares_.data() + corner * TOGETHER, TOGETHER}; }
    Span<const i32> first() const { return row_; }   // the cell at each edge's corner 0
    Span<const i64> steps() const { return steps_; }  // from there to the cells at its corners

    // Compute those of `count` edges from `from` on, which follow those of the call before. False if a node isn't there.
    bool compute(i64 from, i64 count) {
        Span<double> first(first_), low(low_), high(high_);
        std::fill(first.begin(), first.begin() + count, 0.0);
        std::fill(of(0).begin(), of(0).begin() + count, Float(1));
        double last = double(edges_.size - 1), lowest = double(edges_.size - 2), stride = 1;
        for (i64 axis = 0; axis < axes_; ++axis, stride *= double(edges_.size)) {
            for (i64 e = 0; e < count; ++e) {
                // in this order NaN becomes 0
                double place = std::min(std::max(0.0, double(edges_.u(from + e, axis))), 1.0) * last;
                double lower = std::min(double(i32(place)), lowest);
                first[e] += lower * stride;
                high[e] = place - lower;
                low[e] = 1 - high[e];
            }
            for (i64 corner = 0; corner < i64(1) << axis; ++corner) {
                Span<Float> below = of(corner), above = of(corner | i64(1) << axis);
                for (i64 e = 0; e < count; ++e) {
                    double share = below[e];
                    above[e] = Float(share * high[e]);
                    below[e] = Float(share * low[e]);
                }
            }
        }
        for (i64 e = 0; e < count; ++e) row_[e] = i32(first[e]);
        if (!count_members(from, count)) return false;
        for (i64 corner = 0; corner < i64(steps_.size()); ++corner) {
            Span<Float> share = of(corner);
            for (i64 e = 0; e < count; ++e) share[e] /= Span<Float>(members_)[e];
        }
        return true;
    }

private:
    const Edges<Float>& edges_;
    i64 axes_, group_ = 0, size_ = 0;  // axes; the end of the last edge's group, and its size
    std::vector<i32> row_;
    std::vector<double> first_, low_, high_;
    std::vector<Float> members_, shares_;
    std::vector<i64> steps_;

    bool count_members(i64 from, i64 count) {
        for (i64 e = from; e < from + count; ++e) {
            if (e == group_) {
                while (group_ < edges_.target.size() && edges_.target[group_] == edges_.target[e]) ++group_;
                size_ = group_ - e;
            }
            members_[e - from] = Float(size_);
            if (u64(edges_.source[e]) >= u64(edges_.nodes) || u64(edges_.target[e]) >= u64(edges_.nodes)) return false;
        }
        return true;
    }
};

// Call `each(from, count, shares)` for all edges, some at a time. False if one names a node that doesn't exist.
template <class Float, class Each>
bool for_edges(const Edges<Float>& edges, Each each) {
    Shares<Float> shares(edges);
    Interrupt interrupt;
    i64 all = edges.source.size();
    for (i64 from = 0, group = 1; from < all; from += TOGETHER, ++group) {
        if (group % PATIENCE == 0) interrupt.poll();
        i64 count = std::min(TOGETHER, all - from);
        if (!shares.compute(from, count)) return false;
        each(from, count, shares);
    }
    return true;
}

template <class Float>
void add_scaled(Span<Float> out, Float share, Span<const Float> values) {
    for (i64 c = 0; c < out.size(); ++c) out[c] += share * values[c];
}

}  // namespace

template <class Float>
bool dense_sums(Span<const i64> source, Span<const i64> target, Rows<const Float> u, i64 size,
                Rows<const Float> features, Rows<Float> sums) {
    Edges<Float> edges{source, target, u, size, features.rows()};
    i64 cells = edges.nodes ? sums.rows() / edges.nodes : 0;
    if (features.columns() != 1)
        return for_edges(edges, [&](i64 from, i64 count, Shares<Float>& shares) {
            Span<const i64> steps = shares.steps();
            for (i64 e = 0; e < count; ++e)
                for (i64 corner = 0; corner < steps.size(); ++corner)
                    if (Float share = shares.of(corner)[e]; share > 0)
                        add_scaled(sums[target[from + e] * cells + shares.first()[e] + steps[corner]], share,
                                   features[source[from + e]]);
        });
    std::vector<Float> values(TOGETHER);
    return for_edges(edges, [&](i64 from, i64 count, Shares<Float>& shares) {
        Span<const i64> steps = shares.steps();
        Span<const i32> first = shares.first();
        Span<Float> value(values), out = sums.flat();
        for (i64 e = 0; e < count; ++e) value[e] = features.flat()[source[from + e]];
        for (i64 corner = 0; corner < steps.size(); ++corner) {
            Span<Float> share = shares.of(corner);
            // without branches, because which corners are touched is unpredictable
            for (i64 e = 0; e < count; ++e) {
                Float given = share[e] * value[e];
                share[e] = share[e] > 0 ? given : Float(0);
            }
        }
        for (i64 e = 0; e < count; ++e) {
            i64 row = target[from + e] * cells + first[e];
            for (i64 corner = 0; corner < steps.size(); ++corner) out[row + steps[corner]] += shares.of(corner)[e];
        }
    });
}

template <class Float>
bool dense_gradient(Span<const i64> source, Span<const i64> target, Rows<const Float> u, i64 size,
                    Rows<const Float> gradient, Rows<Float> features) {
    Edges<Float> edges{source, target, u, size, features.rows()};
    i64 cells = edges.nodes ? gradient.rows() / edges.nodes : 0;
    return for_edges(edges, [&](i64 from, i64 count, Shares<Float>& shares) {
        Span<const i64> steps = shares.steps();
        for (i64 e = 0; e < count; ++e)
            for (i64 corner = 0; corner < steps.size(); ++corner)
                if (Float share = shares.of(corner)[e]; share > 0)
                    add_scaled(features[source[from + e]], share,
                               gradient[target[from + e] * cells + shares.first()[e] + steps[corner]]);
    });
}

template <class Float>
std::pair<i64, i64> spline_plan(Span<const i64> source, Span<const i64> target, Rows<const Float> u, i64 size,
                                i64 nodes, Span<i64> cell_start, Span<i64> row_node, Span<i32> row, Span<i32> of,
                                Span<Float> share) {
    Edges<Float> edges{source, target, u, size, nodes};
    i64 cells = cell_start.size() - 1, entries = 0, rows = 0;
    std::vector<i64> latest(cells, -1);  // node of the last row of each cell
    std::fill(cell_start.begin(), cell_start.end(), 0);
    // not std::vector, which writes zeros
    std::unique_ptr<i32[]> memory(new i32[3 * row.size()]);
    Span<i32> cell(memory.get(), row.size());              // of each entry
    Span<i32> row_cell(cell.end(), row.size());            // of each row, as nodes have them
    Span<i32> node_of(row_cell.end(), row.size());
    bool there = for_edges(edges, [&](i64 from, i64 count, Shares<Float>& shares) {
        Span<const i64> steps = shares.steps();
        for (i64 e = 0; e < count; ++e) {
            i64 node = target[from + e];
            for (i64 corner = 0; corner < steps.size(); ++corner) {
                Float given = shares.of(corner)[e];
                if (!(given > 0)) continue;
                i64 at = shares.first()[e] + steps[corner];
                if (latest[at] != node) {
                    latest[at] = node;
                    row_cell[rows] = i32(at);
                    node_of[rows++] = i32(node);
                    ++cell_start[at + 1];
                }
                // its number among the cell's rows
                row[entries] = i32(cell_start[at + 1] - 1);
                cell[entries] = i32(at);
                of[entries] = i32(source[from + e]);
                share[entries++] = given;
            }
        }
    });
    if (!there) return {-1, -1};
    for (i64 at = 0; at < cells; ++at) cell_start[at + 1] += cell_start[at];
    for (i64 n = 0; n < entries; ++n) row[n] += i32(cell_start[cell[n]]);
    std::vector<i64> next(cell_start.begin(), cell_start.end());
    for (i64 r = 0; r < rows; ++r) row_node[next[row_cell[r]]++] = node_of[r];
    return {rows, entries};
}

template <class Float>
bool add_shares(Rows<Float> out, Span<const i32> into, Rows<const Float> features, Span<const i32> of,
                Span<const Float> share) {
    Interrupt interrupt;
    for (i64 n = 0; n < into.size(); ++n) {
        if (n % (TOGETHER * PATIENCE) == 0) interrupt.poll();
        if (u64(into[n]) >= u64(out.rows()) || u64(of[n]) >= u64(features.rows())) return false;
        add_scaled(out[into[n]], share[n], features[of[n]]);
    }
    return true;
}

template <class Float>
bool add_rows(Rows<Float> out, Span<const i64> into, Rows<const Float> rows) {
    for (i64 n = 0; n < into.size(); ++n) {
        if (u64(into[n]) >= u64(out.rows())) return false;
        Span<Float> sum = out[into[n]];
        Span<const Float> row = rows[n];
        for (i64 c = 0; c < sum.size(); ++c) sum[c] += row[c];
    }
    return true;
}

template <class Float>
void define_all(nb::module_& module) {
    define<dense_sums<Float>>(module, "dense_sums");
    define<dense_gradient<Float>>(module, "dense_gradient");
    define<spline_plan<Float>>(module, "spline_plan");
    define<add_shares<Float>>(module, "add_shares");
    define<add_rows<Float>>(module, "add_rows");
}

void define_spline(nb::module_& module) {
    define_all<float>(module);
    define_all<double>(module);
}

}  // namespace nvsdata
