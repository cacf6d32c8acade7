// Edges of a graph as bytes (docs/dev/store.md): the number of edges of each node, then the sources. Numbers have 7 bits
// per byte, the lowest first; the highest bit says that another byte follows. A source is stored as its distance from
// the previous source of the same node or, if it is the first one, from the node itself; sign and size share a number.
#include "../native/bind.h"
#include "../native/require.h"

namespace nvsdata {

namespace {

constexpr i64 longest = 5;  // bytes of a number below 2^35

void put(u64 number, u8*& to) {
    for (; number >= 128; number >>= 7) *to++ = u8(number | 128);
    *to++ = u8(number);
}

// Reads a number of up to `longest` bytes; false at the end of the bytes.
bool get(const u8*& from, const u8* end, u64& number) {
    if (from == end) return false;
    number = *from++;
    if (number < 128) return true;
    number &= 127;
    for (int shift = 7; from != end && shift < 7 * longest; shift += 7) {
        u64 byte = *from++;
        number |= (byte & 127) << shift;
        if (byte < 128) return true;
    }
    return false;
}

}  // namespace

// Bytes written to `out`; 0 if targets decrease or a node doesn't exist.
i64 pack_edges(Rows<const i64> edges, i64 nodes, Span<u8> out) {
    require(edges.rows() == 2 && nodes >= 0 && nodes <= i64(1) << 31, "edges must have two nodes");
    require(out.size() >= longest * (nodes + edges.columns()), "there must be room for each number");
    Span<const i64> source = edges[0], target = edges[1];
    u8* to = out.data();
    i64 e = 0;
    for (i64 node = 0; node < nodes; ++node) {
        i64 first = e;
        while (e < edges.columns() && target[e] == node) ++e;
        put(u64(e - first), to);
    }
    if (e < edges.columns()) return 0;
    i64 previous = 0;
    for (e = 0; e < edges.columns(); ++e) {
        if (u64(source[e]) >= u64(nodes)) return 0;
        i64 from = e > 0 && target[e] == target[e - 1] ? previous : target[e];
        i64 distance = source[e] - from;
        put(distance < 0 ? u64(-2 * distance - 1) : u64(2 * distance), to);
        previous = source[e];
    }
    return i64(to - out.data());
}

// Fills `edges`; false if the bytes aren't those of as many edges between `nodes` nodes.
bool unpack_edges(Span<const u8> code, i64 nodes, Rows<i64> edges) {
    require(edges.rows() == 2 && nodes >= 0, "edges must have two nodes");
    Span<i64> source = edges[0], target = edges[1];
    const u8 *degrees = code.data(), *end = degrees + code.size(), *from = degrees;
    u64 number = 0;
    // the sources begin after the degrees
    for (i64 node = 0; node < nodes; ++node)
        if (!get(from, end, number)) return false;
    i64 e = 0;
    for (i64 node = 0; node < nodes; ++node) {
        u64 degree = 0;
        get(degrees, end, degree);
        if (degree > u64(edges.columns() - e)) return false;
        i64 previous = node;
        for (i64 last = e + i64(degree); e < last; ++e) {
            if (!get(from, end, number)) return false;
            previous += number & 1 ? -i64(number / 2) - 1 : i64(number / 2);
            if (u64(previous) >= u64(nodes)) return false;
            source[e] = previous;
            target[e] = node;
        }
    }
    return e == edges.columns() && from == end;
}

void define_edge_code(nb::module_& module) {
    define<pack_edges>(module, "pack_edges");
    define<unpack_edges>(module, "unpack_edges");
}

}  // namespace nvsdata
