// Clusters of nodes: the coarse graph, and features pooled over its clusters.
#include <algorithm>
#include <cmath>
#include <vector>

#include "../native/bind.h"

namespace nvsdata {

namespace {

// Index of the cell that a place is in, that of the border where it is outside, 0 for NaN.
i64 cell_of(double place, i64 width, i64 count) {
    return i64(std::min(std::max(0.0, place / double(width)), double(count - 1)));
}

// Sums wrap; rounded down.
i64 floored(i64 sum, i64 count) { return sum / count - (sum % count < 0); }
i64 added(i64 a, i64 b) { return i64(u64(a) + u64(b)); }
i64 apart(i64 a, i64 b) { return i64(u64(a) - u64(b)); }

}  // namespace

template <class Float>
i64 clusters(Rows<const Float> pos, Span<const i64> t, Span<const i64> ptr, i64 width, i64 height, i64 columns,
             i64 rows, Span<i64> cluster, Rows<float> position, Span<i64> time, Span<i64> graph, Span<i64> new_ptr) {
    struct Sum {
        double x, y;  // exact, of whole pixels: or their floor wouldn't be
        i64 t, first;  // times are summed from that of the first node on: a sum of dates in µs may be beyond 64 bits
        i64 members;
    };
    std::vector<Sum> sums;
    std::vector<i64> slot(columns * rows);
    i64 nodes = pos.rows(), graphs = ptr.size() - 1;
    if (ptr[0] != 0 || ptr[graphs] != nodes) return -1;
    new_ptr[0] = 0;
    for (i64 b = 0; b < graphs; ++b) {
        if (ptr[b] > ptr[b + 1] || ptr[b + 1] > nodes) return -1;
        std::fill(slot.begin(), slot.end(), -1);
        for (i64 i = ptr[b]; i < ptr[b + 1]; ++i) {
            cluster[i] = cell_of(pos(i, 1), height, rows) * columns + cell_of(pos(i, 0), width, columns);
            slot[cluster[i]] = 0;
        }
        for (i64& place : slot)
            if (place == 0) {
                place = i64(sums.size());
                graph[place] = b;
                sums.push_back({});
            }
        for (i64 i = ptr[b]; i < ptr[b + 1]; ++i) {
            cluster[i] = slot[cluster[i]];
            Sum& sum = sums[cluster[i]];
            sum.x += pos(i, 0);
            sum.y += pos(i, 1);
            if (sum.members++ == 0) sum.first = t[i];
            sum.t = added(sum.t, apart(t[i], sum.first));
        }
        new_ptr[b + 1] = i64(sums.size());
    }
    for (std::size_t c = 0; c < sums.size(); ++c) {
        const Sum& sum = sums[c];
        position(c, 0) = float(std::floor(sum.x / double(sum.members)));
        position(c, 1) = float(std::floor(sum.y / double(sum.members)));
        time[c] = added(sum.first, floored(sum.t, sum.members));
    }
    return i64(sums.size());
}

i64 merged_edges(Span<const i64> source, Span<const i64> target, Span<const i64> cluster, i64 count, Rows<i64> edges) {
    std::vector<i64> start(count + 1), arriving(source.size()), mark(count, -1);
    for (i64 e = 0; e < target.size(); ++e) {
        if (u64(target[e]) >= u64(cluster.size()) || u64(source[e]) >= u64(cluster.size())) return -1;
        if (u64(cluster[target[e]]) >= u64(count) || u64(cluster[source[e]]) >= u64(count)) return -1;
        ++start[cluster[target[e]] + 1];
    }
    for (i64 c = 0; c < count; ++c) start[c + 1] += start[c];
    std::vector<i64> next = start;
    for (i64 e = 0; e < target.size(); ++e) arriving[next[cluster[target[e]]]++] = cluster[source[e]];
    Span<i64> sources = edges[0], targets = edges[1];
    i64 kept = 0;
    for (i64 c = 0; c < count; ++c) {
        mark[c] = c;
        i64 first = kept;
        for (i64 k = start[c]; k < start[c + 1]; ++k) {
            i64 s = arriving[k];
            if (mark[s] == c) continue;
            mark[s] = c;
            sources[kept] = s;
            targets[kept++] = c;
        }
        std::sort(sources.begin() + first, sources.begin() + kept);
    }
    return kept;
}

template <class Float>
bool max_rows(Rows<const Float> features, Span<const i64> cluster, Rows<Float> best, Rows<i32> where) {
    std::vector<bool> seen(best.rows());
    i64 channels = features.columns();
    for (i64 i = 0; i < cluster.size(); ++i) {
        if (u64(cluster[i]) >= u64(best.rows())) return false;
        Span<const Float> given = features[i];
        Span<Float> most = best[cluster[i]];
        Span<i32> from = where[cluster[i]];
        if (!seen[cluster[i]]) {
            seen[cluster[i]] = true;
            std::copy(given.begin(), given.end(), most.begin());
            std::fill(from.begin(), from.end(), i32(i));
            continue;
        }
        for (i64 c = 0; c < channels; ++c) {
            Float value = given[c], before = most[c];
            // true of NaN, unless there was one before
            bool more = !(value <= before) & (before == before);
            most[c] = more ? value : before;
            from[c] = more ? i32(i) : from[c];
        }
    }
    return true;
}

template <class Float>
bool mean_rows(Rows<const Float> features, Span<const i64> cluster, Rows<Float> mean, Span<Float> members) {
    i64 count = mean.rows(), channels = features.columns();
    // sums in double precision: they may be beyond single precision where the mean isn't
    std::vector<double> memory(count * channels);
    Rows<double> sums(memory.data(), count, channels);
    for (i64 i = 0; i < cluster.size(); ++i) {
        if (u64(cluster[i]) >= u64(count)) return false;
        members[cluster[i]] += 1;
        Span<const Float> given = features[i];
        Span<double> sum = sums[cluster[i]];
        for (i64 c = 0; c < channels; ++c) sum[c] += double(given[c]);
    }
    for (i64 m = 0; m < count; ++m)
        for (i64 c = 0; c < channels; ++c) mean(m, c) = Float(sums(m, c) / double(members[m]));
    return true;
}

template <class Float>
bool max_rows_back(Rows<const Float> gradient, Rows<const i32> where, Rows<Float> out) {
    for (i64 m = 0; m < where.rows(); ++m)
        for (i64 c = 0; c < gradient.columns(); ++c) {
            if (u64(where(m, c)) >= u64(out.rows())) return false;
            out(where(m, c), c) += gradient(m, c);
        }
    return true;
}

void define_pool(nb::module_& module) {
    define<clusters<float>>(module, "clusters");
    define<clusters<double>>(module, "clusters");
    define<merged_edges>(module, "merged_edges");
    define<max_rows<float>>(module, "max_rows");
    define<max_rows<double>>(module, "max_rows");
    define<mean_rows<float>>(module, "mean_rows");
    define<mean_rows<double>>(module, "mean_rows");
    define<max_rows_back<float>>(module, "max_rows_back");
    define<max_rows_back<double>>(module, "max_rows_back");
}

}  // namespace nvsdata
