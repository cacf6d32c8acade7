// Loops over the edges of a graph.
#include <algorithm>
#include <cmath>

#include "../native/bind.h"
#include "../native/levels.h"
#include "../native/wrap.h"
#include "edges.h"

namespace nvsdata {

namespace {

// Fills `out` with the pseudo-coordinates of edges, along x, y and, if there are three, t; false if a node doesn't
// exist.
template <bool is_signed, int axes>
bool place_edges(Rows<const float> pos, Span<const i64> t, Rows<const i64> edges, float wide, float high, float longest,
                 Rows<float> out) {
    u64 nodes = u64(pos.rows());
    Span<const i64> source = edges[0], target = edges[1];
    Span<const float> at = pos.flat();
    Span<float> to = out.flat();
    for (i64 e = 0; e < edges.columns(); ++e) {
        i64 j = source[e], i = target[e];
        if (u64(j) >= nodes || u64(i) >= nodes) return false;
        to[axes * e] = pseudo_coordinate((at[2 * j] - at[2 * i]) / wide, is_signed);
        to[axes * e + 1] = pseudo_coordinate((at[2 * j + 1] - at[2 * i + 1]) / high, is_signed);
        if (axes == 3) to[axes * e + 2] = pseudo_coordinate(float(minus(t[j], t[i])) / longest, is_signed);
    }
    return true;
}

// Whether all nodes exist and all values are finite, and whether targets never decrease. The loops have no exits, so
// that they are vectorized.
template <class Float>
NVSDATA_INLINE void look_over(const i64* source, const i64* target, i64 edges, const Float* u, i64 values, i64 nodes,
                              bool* sound, bool* sorted) {
    using Bits = std::conditional_t<sizeof(Float) == 4, i32, i64>;
    constexpr Bits infinity = sizeof(Float) == 4 ? Bits(0x7F800000) : Bits(0x7FF0000000000000);
    i64 signs = 0, falls = 0;
    for (i64 e = 0; e < edges; ++e)
        signs |= source[e] | target[e] | minus(nodes - 1, source[e]) | minus(nodes - 1, target[e]);
    for (i64 e = 1; e < edges; ++e) falls |= target[e] < target[e - 1];
    Bits infinite = 0;
    for (i64 k = 0; k < values; ++k) infinite |= Bits((bits_of<Bits>(u[k]) & infinity) == infinity);
    *sound = signs >= 0 && !infinite;
    *sorted = !falls;
}

}  // namespace

void listed_edges(Span<const i32> degree, Rows<const i32> source, Rows<i64> edges) {
    i64 e = 0, all = 0;
    bool fit = degree.size() == source.rows() && edges.rows() == 2;
    for (i32 number : degree) {
        fit &= number >= 0 && number <= source.columns();
        all += number;
    }
    require(fit && all == edges.columns(), "degrees, sources and edges must agree in number");
    for (i64 i = 0; i < degree.size(); ++i)
        for (i32 n = 0; n < degree[i]; ++n, ++e) {
            edges(0, e) = source(i, n);
            edges(1, e) = i;
        }
}

bool pseudo_coordinates(Rows<const float> pos, Span<const i64> t, Rows<const i64> edges, double wide, double high,
                        double longest, bool is_signed, Rows<float> out) {
    require(pos.columns() == 2 && t.size() == pos.rows(), "nodes must have two coordinates and a time");
    require(edges.rows() == 2 && out.rows() == edges.columns(), "edges must have two nodes, and a row of the result");
    require(out.columns() == 2 || out.columns() == 3, "an edge must have two pseudo-coordinates or three");
    auto place = [&](auto loop) { return loop(pos, t, edges, float(wide), float(high), float(longest), out); };
    if (out.columns() == 2) return is_signed ? place(place_edges<true, 2>) : place(place_edges<false, 2>);
    return is_signed ? place(place_edges<true, 3>) : place(place_edges<false, 3>);
}

void event_nodes(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 start,
                 Rows<float> feature, Rows<float> pos, Span<i64> since) {
    i64 n = t.size();
    require(x.size() == n && y.size() == n && p.size() == n && since.size() == n, "columns must be equally long");
    require(feature.rows() == n && feature.columns() == 1 && pos.rows() == n && pos.columns() == 2,
            "an event must have a polarity and two coordinates");
    Span<float> signs = feature.flat(), places = pos.flat();
    for (i64 i = 0; i < n; ++i) {
        signs[i] = float(2 * p[i] - 1);
        places[2 * i] = x[i], places[2 * i + 1] = y[i];
        since[i] = minus(t[i], start);
    }
}

template <class Float>
int check_edges(Span<const i64> source, Span<const i64> target, Rows<const Float> u, i64 nodes) {
    require_edges(source, target, u.rows());
    bool sound, sorted;
    best<look_over<Float>>(source.data(), target.data(), source.size(), u.data(), u.rows() * u.columns(), nodes, &sound,
                           &sorted);
    if (sound) return sorted ? 0 : 1;
    // the fault of the first invalid edge
    for (i64 e = 0; e < source.size(); ++e) {
        if (u64(source[e]) >= u64(nodes) || u64(target[e]) >= u64(nodes)) return 2;
        for (Float value : u[e])
            if (!std::isfinite(value)) return 3;
    }
    return 0;
}

template <class Float>
void with_self_loops(Span<const i64> source, Span<const i64> target, Rows<const Float> u, Float origin, Rows<i64> edges,
                     Rows<Float> out) {
    require_edges(source, target, u.rows());
    i64 nodes = edges.columns() - source.size(), e = 0, at = 0;
    require(edges.rows() == 2 && nodes >= 0, "there must be room for each edge and for a loop of each node");
    require(out.rows() == edges.columns() && out.columns() == u.columns(), "results must fit the edges");
    for (i64 node = 0; node < nodes; ++node) {
        edges(0, at) = edges(1, at) = node;
        for (Float& value : out[at]) value = origin;
        for (++at; e < source.size() && target[e] == node; ++e, ++at) {
            edges(0, at) = source[e];
            edges(1, at) = node;
            std::copy(u[e].begin(), u[e].end(), out[at].begin());
        }
    }
}

void define_edges(nb::module_& module) {
    define<listed_edges>(module, "listed_edges");
    define<event_nodes>(module, "event_nodes");
    define<pseudo_coordinates>(module, "pseudo_coordinates");
    define<check_edges<float>, check_edges<double>>(module, "check_edges");
    define<with_self_loops<float>, with_self_loops<double>>(module, "with_self_loops");
}

}  // namespace nvsdata
