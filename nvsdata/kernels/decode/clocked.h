// Records of eight bytes: an address, and a time from a 32-bit counter.
//
// A layout says how they are read: `turned(word)` is a record, read as a little-endian number, with the address in its
// upper half and the time in its lower half; `place(address)` is what an address means.
#pragma once

#include <algorithm>

#include "../native/levels.h"
#include "clock.h"
#include "columns.h"

namespace nvsdata {

struct Place {
    i32 x, y;
    u32 on, other;  // polarity, not valid above 1; bits that only a record other than an event has
};

// Decode all words except the first, which belongs to the previous record, as if all were events on the sensor and
// times never decreased; set `has_invalid` if a record isn't such an event, or if a time decreases.
template <class Layout>
NVSDATA_INLINE void decode_evenly(Layout layout, Span<const u64> words, i64 offset, i32 right, i32 bottom, Columns out,
                                  int* has_invalid) {
    int strange = 0;
    for (i64 i = 0; i < out.t.size(); ++i) {
        u64 word = layout.turned(words[i + 1]);
        u32 time = u32(word), before = u32(layout.turned(words[i]));
        Place place = layout.place(u32(word >> 32));
        strange |= (place.other != 0) | (place.on > 1) | (time < before);
        strange |= (u32(place.x) >= u32(right)) | (u32(place.y) >= u32(bottom));
        out.t[i] = plus(time, offset);
        out.x[i] = i16(place.x);
        out.y[i] = i16(place.y);
        out.p[i] = u8(place.on);
    }
    *has_invalid |= strange;
}

// Decode records; those that aren't events are left out. `block`: number of records in a block, for the clock `state`.
template <class Layout>
Found decode_clocked(Layout layout, Span<const u8> raw, i64 block, i64 width, i64 height, Span<i64> state,
                     Columns out) {
    constexpr i64 TOGETHER = 512, FURTHEST = 1 << 15;  // records that are decoded together; pixels beyond any place
    Clock clock(state);
    i64 size = raw.size() / 8;
    if (size == 0) return {0, -1};
    auto record = [&](i64 i) { return layout.turned(word_at<u64>(raw, 8 * i)); };
    i32 right = i32(std::clamp<i64>(width, 0, FURTHEST)), bottom = i32(std::clamp<i64>(height, 0, FURTHEST));
    i64 begun = u32(record(0)), ended = u32(record(size - 1));
    clock.begin(begun);
    i64 offset = minus(nearest(begun, clock.last(), 32), begun);
    int has_invalid = clock.mixed() || ended - begun >= WRAP_US / 2;
    alignas(64) u64 words[TOGETHER + 1];  // a copy that no column overlaps, so that loops are vectorized
    // the first record that isn't an event usually comes early, so little is decoded twice
    for (i64 from = 0; from < size && !has_invalid; from += TOGETHER) {
        i64 some = std::min(TOGETHER, size - from);
        words[0] = word_at<u64>(raw, 8 * std::max<i64>(from - 1, 0));
        std::memcpy(words + 1, raw.part(8 * from, 8 * (from + some)).data(), std::size_t(8 * some));
        best<decode_evenly<Layout>>(layout, Span<const u64>(words, some + 1), offset, right, bottom,
                                    out.part(from, from + some), &has_invalid);
    }
    if (!has_invalid) {
        clock.go_evenly(out.t, block);
        return {size, -1};
    }
    for (i64 i = 0; i < size; ++i) out.t[i] = u32(record(i));
    clock.unwrap(out.t, block);
    i64 count = 0, bad = -1;
    for (i64 i = 0; i < size; ++i) {
        Place place = layout.place(u32(record(i) >> 32));
        out.t[count] = out.t[i];
        out.x[count] = i16(place.x);
        out.y[count] = i16(place.y);
        out.p[count] = u8(place.on);
        bool invalid = place.on > 1 || u32(place.x) >= u32(right) || u32(place.y) >= u32(bottom);
        if (place.other == 0 && invalid && bad < 0) bad = i;
        count += place.other == 0;
    }
    clock.mixed() |= count < size;
    return {count, bad};
}

}  // namespace nvsdata
