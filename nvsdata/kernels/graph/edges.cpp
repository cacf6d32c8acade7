// Loops over the edges of a graph.
#include <algorithm>
#include <cmath>

#include "../native/bind.h"
#include "../native/wrap.h"
#include "edges.h"

namespace nvsdata {

namespace {

// Pseudo-coordinates of edges, along x, y and, if there are three, t.
struct Pseudo {
    Rows<const float> pos;
    Span<const i64> t;
    float wide, high, longest;  // differences that count as 1
    bool is_signed;

    void place(Span<float> out, i64 source, i64 target) const {
        out[0] = pseudo_coordinate((pos(source, 0) - pos(target, 0)) / wide, is_signed);
        out[1] = pseudo_coordinate((pos(source, 1) - pos(target, 1)) / high, is_signed);
        if (out.size() == 3) out[2] = pseudo_coordinate(float(minus(t[source], t[target])) / longest, is_signed);
    }
};

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
    Pseudo pseudo{pos, t, float(wide), float(high), float(longest), is_signed};
    u64 nodes = u64(pos.rows());
    for (i64 e = 0; e < edges.columns(); ++e) {
        i64 j = edges(0, e), i = edges(1, e);
        if (u64(j) >= nodes || u64(i) >= nodes) return false;
        pseudo.place(out[e], j, i);
    }
    return true;
}

template <class Float>
int check_edges(Span<const i64> source, Span<const i64> target, Rows<const Float> u, i64 nodes) {
    require_edges(source, target, u.rows());
    int code = 0;
    i64 last = 0;
    for (i64 e = 0; e < source.size(); ++e) {
        if (u64(source[e]) >= u64(nodes) || u64(target[e]) >= u64(nodes)) return 2;
        for (Float value : u[e])
            if (!std::isfinite(value)) return 3;
        if (target[e] < last) code = 1;
        last = target[e];
    }
    return code;
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
    define<pseudo_coordinates>(module, "pseudo_coordinates");
    define<check_edges<float>>(module, "check_edges");
    define<check_edges<double>>(module, "check_edges");
    define<with_self_loops<float>>(module, "with_self_loops");
    define<with_self_loops<double>>(module, "with_self_loops");
}

}  // namespace nvsdata
