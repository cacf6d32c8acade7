// Clusters of nodes: the coarse graph, and features pooled over its clusters.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "../native/bind.h"
#include "../native/indexes.h"
#include "../native/interrupt.h"
#include "../native/levels.h"
#include "../native/require.h"
#include "../native/vector.h"
#include "../native/wrap.h"

namespace nvsdata {

namespace {

constexpr i64 MOST_CELLS = std::numeric_limits<i32>::max();
constexpr i64 OFTEN = 1 << 12;  // clusters, or nodes, between two polls for Ctrl-C

// Sums over the nodes of a cluster.
struct Sum {
    double x, y;    // sums of integers, which are exact, so the floor of the mean is, too
    i64 t, first;   // sum of times since the first node, which can't overflow; time of the first node
    i64 members;
};

// Index of the cell at a place; a place outside belongs to the border, and NaN to cell 0.
i64 cell_at(double place, i64 side, i64 count) {
    return i64(std::min(std::max(0.0, place / double(side)), double(count - 1)));
}

// First time plus the rounded mean, modulo 2^64.
i64 mean_time(const Sum& sum) {
    return plus(sum.first, floor_divide(sum.t, sum.members));
}

void check_clusters(i64 nodes, Span<const i64> cluster, i64 count) {
    require(nodes == cluster.size(), "features and clusters are of different numbers of nodes");
    check_below(cluster, count, "a node's cluster doesn't exist");
}

// Calls each(from, to) for parts of `count` rows.
template <class Each>
void each_part(i64 count, Each each) {
    Interrupt interrupt;
    for (i64 from = 0; from < count; from += OFTEN) {
        interrupt.poll();
        each(from, std::min(from + OFTEN, count));
    }
}

// Update the largest features for nodes from number `first` on.
template <class Float>
NVSDATA_INLINE void take_larger(Rows<const Float> features, Span<const i64> cluster, Rows<Float> best,
                                Rows<i32> where, i64 first, Span<u8> seen) {
    for (i64 i = 0; i < cluster.size(); ++i) {
        i64 home = cluster[i];
        i32 node = i32(first + i);
        Span<const Float> given = features[i];
        Span<Float> most = best[home];
        Span<i32> from = where[home];
        if (!seen[home]) {
            seen[home] = 1;
            for (i64 c = 0; c < given.size(); ++c) {
                most[c] = given[c];
                from[c] = node;
            }
            continue;
        }
        for (i64 c = 0; c < given.size(); ++c) {
            Float value = given[c], before = most[c];
            // true for the first NaN
            bool more = !(value <= before) & (before == before);
            most[c] = more ? value : before;
            from[c] = more ? node : from[c];
        }
    }
}

template <class Float>
NVSDATA_INLINE void add_up(Rows<const Float> features, Span<const i64> cluster, i64 from, i64 to, Rows<double> sums,
                           Span<Float> members) {
    for (i64 i = from; i < to; ++i) {
        members[cluster[i]] += 1;
        Span<const Float> given = features[i];
        Span<double> sum = sums[cluster[i]];
        for (i64 c = 0; c < given.size(); ++c) sum[c] += double(given[c]);
    }
}

template <class Float>
NVSDATA_INLINE void divide(Rows<const double> sums, Span<const Float> members, Rows<Float> mean) {
    for (i64 m = 0; m < mean.rows(); ++m) {
        Span<Float> out = mean[m];
        Span<const double> sum = sums[m];
        double count = double(members[m]);
        for (i64 c = 0; c < out.size(); ++c) out[c] = Float(sum[c] / count);
    }
}

}  // namespace

template <class Float>
i64 clusters(Rows<const Float> pos, Span<const i64> t, Span<const i64> ptr, i64 width, i64 height, i64 columns,
             i64 rows, Span<i64> cluster, Rows<float> position, Span<i64> time, Span<i64> graph, Span<i64> new_ptr) {
    i64 nodes = pos.rows(), graphs = ptr.size() - 1, last = 0;
    require(pos.columns() == 2 && t.size() == nodes && cluster.size() == nodes,
            "nodes must have two coordinates, a time and a cluster");
    require(width > 0 && height > 0 && columns > 0 && rows > 0 && columns <= MOST_CELLS / rows, "no such clusters");
    for (i64 after : ptr) {
        require(after >= last && after <= nodes, "ptr decreases, or is beyond the nodes");
        last = after;
    }
    require(!ptr.empty() && ptr[0] == 0 && last == nodes, "ptr leaves nodes out");
    require(new_ptr.size() == ptr.size(), "graphs must be as many before and after");
    i64 most = std::min(nodes, graphs * columns * rows);
    require(position.columns() == 2 && std::min({position.rows(), time.size(), graph.size()}) >= most,
            "there must be room for the clusters");
    Interrupt interrupt;
    Vector<Sum> sums;
    Vector<i64> slot(columns * rows);
    new_ptr[0] = 0;
    for (i64 b = 0; b < graphs; ++b) {
        std::fill(slot.begin(), slot.end(), -1);
        for (i64 i = ptr[b]; i < ptr[b + 1]; ++i) {
            cluster[i] = cell_at(pos(i, 1), height, rows) * columns + cell_at(pos(i, 0), width, columns);
            slot[cluster[i]] = 0;
        }
        for (i64 cell = 0; cell < columns * rows; ++cell)
            if (slot[cell] == 0) {
                slot[cell] = i64(sums.size());
                graph[slot[cell]] = b;
                sums.push_back({});
            }
        for (i64 i = ptr[b]; i < ptr[b + 1]; ++i) {
            if (i % OFTEN == 0) interrupt.poll();
            cluster[i] = slot[cluster[i]];
            Sum& sum = sums[cluster[i]];
            sum.x += double(pos(i, 0));
            sum.y += double(pos(i, 1));
            if (sum.members++ == 0) sum.first = t[i];
            sum.t = plus(sum.t, minus(t[i], sum.first));
        }
        new_ptr[b + 1] = i64(sums.size());
    }
    for (i64 c = 0; c < i64(sums.size()); ++c) {
        position(c, 0) = float(std::floor(sums[c].x / double(sums[c].members)));
        position(c, 1) = float(std::floor(sums[c].y / double(sums[c].members)));
        time[c] = mean_time(sums[c]);
    }
    return i64(sums.size());
}

i64 merged_edges(Span<const i64> source, Span<const i64> target, Span<const i64> cluster, i64 count, Rows<i64> edges) {
    require(source.size() == target.size(), "numbers of sources and targets differ");
    require(edges.rows() == 2 && edges.columns() >= source.size(), "there must be room for the edges");
    i64 nodes = cluster.size(), kept = 0;
    check_below(source, nodes, "an edge names a node that doesn't exist");
    check_below(target, nodes, "an edge names a node that doesn't exist");
    check_below(cluster, count, "a node's cluster doesn't exist");
    require(std::is_sorted(target.begin(), target.end()), "edges aren't grouped by target");
    // first edge of each node, and first node of each cluster
    Vector<i64> first(nodes + 1), begin(count + 1), members(nodes), mark(count, -1);
    for (i64 node : target) ++first[node + 1];
    for (i64 node = 0; node < nodes; ++node) {
        first[node + 1] += first[node];
        ++begin[cluster[node] + 1];
    }
    for (i64 c = 0; c < count; ++c) begin[c + 1] += begin[c];
    Vector<i64> next = begin;
    for (i64 node = 0; node < nodes; ++node) members[next[cluster[node]]++] = node;
    Span<i64> sources = edges[0], targets = edges[1];
    Interrupt interrupt;
    for (i64 c = 0; c < count; ++c) {
        if (c % OFTEN == 0) interrupt.poll();
        mark[c] = c;
        i64 from = kept;
        for (i64 m = begin[c]; m < begin[c + 1]; ++m)
            for (i64 e = first[members[m]]; e < first[members[m] + 1]; ++e) {
                // no branch, because it is unpredictable which edges are repeated
                i64 s = cluster[source[e]];
                sources[kept] = s;
                targets[kept] = c;
                kept += std::exchange(mark[s], c) != c;
            }
        std::sort(sources.begin() + from, sources.begin() + kept);
    }
    return kept;
}

template <class Float>
void max_rows(Rows<const Float> features, Span<const i64> cluster, Rows<Float> best, Rows<i32> where) {
    check_clusters(features.rows(), cluster, best.rows());
    require(best.columns() == features.columns() && where.rows() == best.rows() && where.columns() == best.columns(),
            "maxima must have the channels of the features");
    Vector<u8> seen(best.rows());
    each_part(cluster.size(), [&](i64 from, i64 to) {
        Rows<const Float> some(features.data() + from * features.columns(), to - from, features.columns());
        nvsdata::best<take_larger<Float>>(some, cluster.part(from, to), best, where, from, Span<u8>(seen));
    });
    for (i64 m = 0; m < best.rows(); ++m) {
        if (seen[m]) continue;
        std::fill(best[m].begin(), best[m].end(), Float(0));
        std::fill(where[m].begin(), where[m].end(), -1);
    }
}

template <class Float>
void max_rows_back(Rows<const Float> gradient, Rows<const i32> where, Rows<Float> out) {
    require(gradient.rows() == where.rows() && gradient.columns() == where.columns() &&
                out.columns() == where.columns(),
            "a gradient of another shape than the maxima");
    check_below(where.flat(), out.rows(), "a maximum is of a node that doesn't exist");
    each_part(where.rows(), [&](i64 begin, i64 end) {
        for (i64 m = begin; m < end; ++m) {
            Span<const i32> from = where[m];
            Span<const Float> given = gradient[m];
            for (i64 c = 0; c < given.size(); ++c) out(from[c], c) += given[c];
        }
    });
}

template <class Float>
void mean_rows(Rows<const Float> features, Span<const i64> cluster, Rows<Float> mean, Span<Float> members) {
    check_clusters(features.rows(), cluster, mean.rows());
    require(mean.columns() == features.columns() && members.size() == mean.rows(),
            "means must have the channels of the features, and each its number of members");
    // in double precision, because a sum may overflow single precision even if the mean doesn't
    Vector<double> memory(mean.rows() * mean.columns());
    Rows<double> sums(memory.data(), mean.rows(), mean.columns());
    each_part(cluster.size(), [&](i64 from, i64 to) {
        best<add_up<Float>>(features, cluster, from, to, sums, members);
    });
    best<divide<Float>>(Rows<const double>(sums), Span<const Float>(members), mean);
}

template <class Float>
void define_features(nb::module_& module) {
    define<clusters<Float>>(module, "clusters");
    define<max_rows<Float>>(module, "max_rows");
    define<max_rows_back<Float>>(module, "max_rows_back");
    define<mean_rows<Float>>(module, "mean_rows");
}

void define_pool(nb::module_& module) {
    define<merged_edges>(module, "merged_edges");
    define_features<float>(module);
    define_features<double>(module);
}

}  // namespace nvsdata
