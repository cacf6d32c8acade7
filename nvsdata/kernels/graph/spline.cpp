// B-spline aggregation: each edge adds shares of its source's features to the kernel cells of its target.
#include <algorithm>
#include <limits>
#include <memory>
#include <stdexcept>

#include "../native/bind.h"
#include "../native/indexes.h"
#include "../native/interrupt.h"
#include "../native/levels.h"
#include "../native/vector.h"
#include "edges.h"

namespace nvsdata {

namespace {

constexpr i64 TOGETHER = 128;  // edges whose shares are computed together
constexpr i64 PATIENCE = 64;   // such groups between two polls for Ctrl-C
constexpr i64 MOST_CELLS = std::numeric_limits<i32>::max();

// Edges grouped by target, with pseudo-coordinates in 0..1, and the number of cells of the kernel along each axis.
template <class Float>
struct Edges {
    Span<const i64> source, target;
    Rows<const Float> u;
    i64 size, nodes;

    // Number of cells of the kernel.
    i64 check() const {
        require_edges(source, target, u.rows());
        i64 cells = 1;
        for (i64 axis = 0; axis < u.columns(); ++axis) {
            require(size >= 1 && cells <= MOST_CELLS / size, "no such kernel");
            cells *= size;
        }
        return cells;
    }
};

// For some edges: the kernel cells at the 2^D corners around each edge, and its shares of them, for B-splines of degree
// 1.
template <class Float>
struct Corners {
    Vector<i64> steps{0};       // from the cell at corner 0 to the cells at the other corners
    Vector<i32> first;          // the cell at each edge's corner 0
    Vector<Float> memory;       // shares, corner by corner: 0 where an edge doesn't touch the cell
    Vector<double> place, low, high;
    Vector<Float> members;      // number of edges of the target of each edge; exact up to 2^24

    explicit Corners(const Edges<Float>& edges)
        : first(TOGETHER), place(TOGETHER), low(TOGETHER), high(TOGETHER), members(TOGETHER) {
        // there is an array of size^D cells, so D is small; a kernel of one cell has no other corners
        i64 stride = 1;
        for (i64 axis = 0; edges.size > 1 && axis < edges.u.columns(); ++axis, stride *= edges.size)
            for (i64 corner = 0; corner < i64(1) << axis; ++corner) steps.push_back(steps[corner] + stride);
        memory.resize(steps.size() * TOGETHER);
    }
    i64 count() const { return i64(steps.size()); }
    Span<Float> shares(i64 corner) { return {memory.data() + corner * TOGETHER, TOGETHER}; }
    i64 cell(i64 corner, i64 e) { return Span<i32>(first)[e] + Span<i64>(steps)[corner]; }
};

// Compute the shares of `count` edges; `members` must be set.
template <class Float>
NVSDATA_INLINE void share_out(Corners<Float>* corners, const Float* of, i64 axes, i64 size, i64 count) {
    Span<double> place(corners->place), low(corners->low), high(corners->high);
    Span<i32> first(corners->first);
    Rows<const Float> u(of, count, axes);
    double last = double(size - 1), lowest = double(size - 2), stride = 1;
    for (i64 e = 0; e < count; ++e) place[e] = 0;
    for (i64 e = 0; e < count; ++e) corners->shares(0)[e] = 1;
    for (i64 axis = 0; size > 1 && axis < axes; ++axis, stride *= double(size)) {
        for (i64 e = 0; e < count; ++e) {
            // in this order NaN becomes 0
            double at = std::min(std::max(0.0, double(u(e, axis))), 1.0) * last;
            double lower = std::min(double(i32(at)), lowest);
            place[e] += lower * stride;
            high[e] = at - lower;
            low[e] = 1 - high[e];
        }
        for (i64 corner = 0; corner < i64(1) << axis; ++corner) {
            Span<Float> below = corners->shares(corner), above = corners->shares(corner | i64(1) << axis);
            for (i64 e = 0; e < count; ++e) {
                double share = below[e];
                above[e] = Float(share * high[e]);
                below[e] = Float(share * low[e]);
            }
        }
    }
    for (i64 e = 0; e < count; ++e) first[e] = i32(place[e]);
    Span<Float> members(corners->members);
    for (i64 corner = 0; corner < corners->count(); ++corner) {
        Span<Float> share = corners->shares(corner);
        for (i64 e = 0; e < count; ++e) share[e] /= members[e];
    }
}

// Call `each(from, count, corners)` for all edges, some at a time.
template <class Float, class Each>
void for_edges(const Edges<Float>& edges, Each each) {
    Corners<Float> corners(edges);
    Interrupt interrupt;
    i64 all = edges.source.size(), group = 0, size = 0;
    for (i64 from = 0; from < all; from += TOGETHER) {
        if (from % (TOGETHER * PATIENCE) == 0) interrupt.poll();
        i64 count = std::min(TOGETHER, all - from);
        for (i64 e = from; e < from + count; ++e) {
            if (e == group) {
                while (group < all && edges.target[group] == edges.target[e]) ++group;
                size = group - e;
            }
            corners.members[e - from] = Float(size);
            if (u64(edges.source[e]) >= u64(edges.nodes) || u64(edges.target[e]) >= u64(edges.nodes))
                throw std::out_of_range("an edge names a node that doesn't exist");
        }
        i64 axes = edges.u.columns();
        best<share_out<Float>>(&corners, edges.u.data() + from * axes, axes, edges.size, count);
        each(from, count, corners);
    }
}

template <class Float>
NVSDATA_INLINE void add_scaled(Span<Float> out, Float share, Span<const Float> values) {
    for (i64 c = 0; c < out.size(); ++c) out[c] += share * values[c];
}

template <class Float>
NVSDATA_INLINE void add_all_scaled(Rows<Float> out, Span<const i32> into, Rows<const Float> features,
                                   Span<const i32> of, Span<const Float> share) {
    for (i64 n = 0; n < into.size(); ++n) add_scaled(out[into[n]], share[n], features[of[n]]);
}

template <class Float>
NVSDATA_INLINE void add_all_rows(Rows<Float> out, Span<const i64> into, Rows<const Float> rows) {
    for (i64 n = 0; n < into.size(); ++n) {
        Span<Float> sum = out[into[n]];
        Span<const Float> row = rows[n];
        for (i64 c = 0; c < sum.size(); ++c) sum[c] += row[c];
    }
}

}  // namespace

template <class Float>
void dense_sums(Span<const i64> source, Span<const i64> target, Rows<const Float> u, i64 size,
                Rows<const Float> features, Rows<Float> sums) {
    Edges<Float> edges{source, target, u, size, features.rows()};
    i64 cells = edges.check();
    require(sums.rows() == edges.nodes * cells && sums.columns() == features.columns(),
            "sums must have a row for each cell of each node, and the channels of the features");
    if (features.columns() != 1)
        return for_edges(edges, [&](i64 from, i64 count, Corners<Float>& corners) {
            for (i64 e = 0; e < count; ++e)
                for (i64 corner = 0; corner < corners.count(); ++corner)
                    if (Float share = corners.shares(corner)[e]; share > 0)
                        add_scaled(sums[target[from + e] * cells + corners.cell(corner, e)], share,
                                   features[source[from + e]]);
        });
    Vector<Float> values(TOGETHER);
    for_edges(edges, [&](i64 from, i64 count, Corners<Float>& corners) {
        Span<Float> value(values), out = sums.flat();
        for (i64 e = 0; e < count; ++e) value[e] = features.flat()[source[from + e]];
        // without branches, because it is unpredictable which corners are touched
        for (i64 corner = 0; corner < corners.count(); ++corner) {
            Span<Float> share = corners.shares(corner);
            for (i64 e = 0; e < count; ++e) {
                Float given = share[e] * value[e];
                share[e] = share[e] > 0 ? given : Float(0);
            }
        }
        for (i64 e = 0; e < count; ++e) {
            i64 row = target[from + e] * cells;
            for (i64 corner = 0; corner < corners.count(); ++corner)
                out[row + corners.cell(corner, e)] += corners.shares(corner)[e];
        }
    });
}

template <class Float>
void dense_gradient(Span<const i64> source, Span<const i64> target, Rows<const Float> u, i64 size,
                    Rows<const Float> gradient, Rows<Float> features) {
    Edges<Float> edges{source, target, u, size, features.rows()};
    i64 cells = edges.check();
    require(gradient.rows() == edges.nodes * cells && gradient.columns() == features.columns(),
            "gradients must have a row for each cell of each node, and the channels of the features");
    bool single = features.columns() == 1;
    for_edges(edges, [&](i64 from, i64 count, Corners<Float>& corners) {
        for (i64 e = 0; e < count; ++e) {
            i64 row = target[from + e] * cells, node = source[from + e];
            if (single) {
                // without branches, as above
                Float sum = features.flat()[node];
                for (i64 corner = 0; corner < corners.count(); ++corner) {
                    Float share = corners.shares(corner)[e];
                    Float given = share * gradient.flat()[row + corners.cell(corner, e)];
                    sum += share > 0 ? given : Float(0);
                }
                features.flat()[node] = sum;
                continue;
            }
            for (i64 corner = 0; corner < corners.count(); ++corner)
                if (Float share = corners.shares(corner)[e]; share > 0)
                    add_scaled(features[node], share, gradient[row + corners.cell(corner, e)]);
        }
    });
}

template <class Float>
std::pair<i64, i64> spline_plan(Span<const i64> source, Span<const i64> target, Rows<const Float> u, i64 size,
                                i64 nodes, Span<i64> cell_start, Span<i64> row_node, Span<i32> row, Span<i32> of,
                                Span<Float> share) {
    Edges<Float> edges{source, target, u, size, nodes};
    i64 cells = edges.check(), entries = 0, rows = 0, most = source.size() << (size > 1 ? u.columns() : 0);
    require(cell_start.size() == cells + 1, "there must be a place for the beginning of each cell");
    require(row_node.size() >= most && row.size() >= most && of.size() >= most && share.size() >= most,
            "there must be room for as many entries as edges have corners");
    Vector<i64> latest(cells, -1);  // node of the last row of each cell
    std::fill(cell_start.begin(), cell_start.end(), 0);
    // not Vector, which writes zeros
    std::unique_ptr<i32[]> memory(new i32[3 * row.size()]);
    Span<i32> cell(memory.get(), row.size());    // cell of each entry
    Span<i32> row_cell(cell.end(), row.size());  // cell of each row, in order of nodes
    Span<i32> node_of(row_cell.end(), row.size());
    for_edges(edges, [&](i64 from, i64 count, Corners<Float>& corners) {
        for (i64 e = 0; e < count; ++e) {
            i64 node = target[from + e];
            for (i64 corner = 0; corner < corners.count(); ++corner) {
                Float given = corners.shares(corner)[e];
                if (!(given > 0)) continue;
                i64 at = corners.cell(corner, e);
                if (latest[at] != node) {
                    latest[at] = node;
                    row_cell[rows] = i32(at);
                    node_of[rows++] = i32(node);
                    ++cell_start[at + 1];
                }
                // its number among the rows of the cell
                row[entries] = i32(cell_start[at + 1] - 1);
                cell[entries] = i32(at);
                of[entries] = i32(source[from + e]);
                share[entries++] = given;
            }
        }
    });
    for (i64 at = 0; at < cells; ++at) cell_start[at + 1] += cell_start[at];
    for (i64 n = 0; n < entries; ++n) row[n] += i32(cell_start[cell[n]]);
    Vector<i64> next(cell_start.begin(), cell_start.end());
    for (i64 r = 0; r < rows; ++r) row_node[next[row_cell[r]]++] = node_of[r];
    return {rows, entries};
}

template <class Float>
void add_shares(Rows<Float> out, Span<const i32> into, Rows<const Float> features, Span<const i32> of,
                Span<const Float> share) {
    i64 all = into.size();
    require(of.size() == all && share.size() == all && features.columns() == out.columns(),
            "entries, or channels, differ in number");
    check_below(into, out.rows(), "a row that doesn't exist");
    check_below(of, features.rows(), "a row of features that doesn't exist");
    Interrupt interrupt;
    for (i64 from = 0; from < all; from += TOGETHER * PATIENCE) {
        interrupt.poll();
        i64 to = std::min(all, from + TOGETHER * PATIENCE);
        best<add_all_scaled<Float>>(out, into.part(from, to), features, of.part(from, to), share.part(from, to));
    }
}

template <class Float>
void add_rows(Rows<Float> out, Span<const i64> into, Rows<const Float> rows) {
    require(into.size() == rows.rows() && rows.columns() == out.columns(), "rows, or channels, differ in number");
    check_below(into, out.rows(), "a row that doesn't exist");
    best<add_all_rows<Float>>(out, into, rows);
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
