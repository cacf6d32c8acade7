// Events moved to other pixels by a table.
#include "../native/bind.h"
#include "../native/random.h"
#include "events.h"

namespace nvsdata {

namespace {

enum Kind : u32 { none, one, several };  // targets of a pixel, in the two highest bits of its entry

constexpr u32 KIND_BIT = 30, COORDINATE_BITS = 15, COORDINATE = (1u << COORDINATE_BITS) - 1;

// The target of an event at a pixel with several: lists begin with their size.
u32 choose(Span<const u32> lists, u32 begin, i64 time, u32 place) {
    if (begin >= lists.size()) throw std::out_of_range("a table reaches beyond its targets");
    u64 count = lists[begin];
    if (count < 1 || begin + count >= u64(lists.size()))
        throw std::out_of_range("a table reaches beyond its targets");
    return lists[i64(begin + 1 + ((random_bits(u64(time) * step + place) >> 32) * count >> 32))];
}

i64 move_events(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Rows<const u32> table,
                Span<const u32> lists, Span<i64> new_t, Span<i16> new_x, Span<i16> new_y, Span<u8> new_p) {
    i64 n = t.size(), kept = 0;
    require_columns(n, {x, y, p});
    // one more, because the place behind the last kept event is written, too
    require_shapes(new_t.size() > n && new_x.size() > n && new_y.size() > n && new_p.size() > n);
    Span<const u32> entries = table.flat();
    each_event({table.columns(), table.rows()}, {x, y}, [&](i64 i, i64 place) {
        u32 entry = entries[place], kind = entry >> KIND_BIT;
        if (kind == several) entry = choose(lists, entry & ((1u << KIND_BIT) - 1), t[i], u32(place));
        new_t[kept] = t[i];
        new_x[kept] = i16(entry & COORDINATE);
        new_y[kept] = i16(entry >> COORDINATE_BITS & COORDINATE);
        new_p[kept] = p[i];
        kept += kind != none;
    });
    return kept;
}

}  // namespace

void define_moves(nb::module_& module) { define<move_events>(module, "move_events"); }

}  // namespace nvsdata
