// Loops over the edges of a graph.
#include <algorithm>
#include <cmath>

#include "../native/bind.h"
#include "../native/wrap.h"

namespace nvsdata {

namespace {

float fraction(float d, bool is_signed) {
    return is_signed ? std::min(std::max(d * 0.5f + 0.5f, 0.0f), 1.0f) : std::min(std::abs(d), 1.0f);
}

// Pseudo-coordinates of edges, along x, y and, if there are three, t.
struct Pseudo {
    Rows<const float> pos;
    Span<const i64> t;
    float wide, high, longest;  // differences that count as 1
    bool is_signed;

    void place(Span<float> out, i64 source, i64 target) const {
        out[0] = fraction((pos(source, 0) - pos(target, 0)) / wide, is_signed);
        out[1] = fraction((pos(source, 1) - pos(target, 1)) / high, is_signed);
        if (out.size() == 3) out[2] = fraction(float(minus(t[source], t[target])) / longest, is_signed);
    }
};

}  // namespace

void event_edges(Span<const i32> degree, Rows<const i32> source, Rows<const float> pos, Span<const i64> t,
                 double wide, double high, double longest, bool is_signed, Rows<i64> edges, Rows<float> out) {
    Pseudo pseudo{pos, t, float(wide), float(high), float(longest), is_signed};
    i64 e = 0;
    for (i64 i = 0; i < degree.size(); ++i)
        for (i32 n = 0; n < degree[i]; ++n, ++e) {
            i64 j = source(i, n);
            edges(0, e) = j;
            edges(1, e) = i;
            pseudo.place(out[e], j, i);
        }
}

void listed_edges(Span<const i32> degree, Rows<const i32> source, Rows<i64> edges) {
    i64 e = 0;
    for (i64 i = 0; i < degree.size(); ++i)
        for (i32 n = 0; n < degree[i]; ++n, ++e) {
            edges(0, e) = source(i, n);
            edges(1, e) = i;
        }
}

bool pseudo_coordinates(Rows<const float> pos, Span<const i64> t, Rows<const i64> edges, double wide, double high, double longest, bool is_signed, Rows<float> out) {
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
    i64 nodes = edges.columns() - source.size(), e = 0, at = 0;
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
    define<event_edges>(module, "event_edges");
    define<listed_edges>(module, "listed_edges");
    define<pseudo_coordinates>(module, "pseudo_coordinates");
    define<check_edges<float>>(module, "check_edges");
    define<check_edges<double>>(module, "check_edges");
    define<with_self_loops<float>>(module, "with_self_loops");
    define<with_self_loops<double>>(module, "with_self_loops");
}

}  // namespace nvsdata
