// Records of ATIS cameras, five bytes each; see columns.h for what a decoder returns.
#include <algorithm>

#include "../native/bind.h"
#include "../native/interrupt.h"
#include "../native/levels.h"
#include "clock.h"
#include "columns.h"
#include "events.h"

namespace nvsdata {

namespace {

constexpr i64 SIZE = 5;                // bytes of a record
constexpr i64 MARKER_Y = 240;          // y of an overflow record, which adds to later times; a larger y is damage
constexpr i64 MARKER_US = 1 << 13;     // µs that an overflow record adds
constexpr i64 FULL_US = i64(1) << 23;  // the time in a record is below it
constexpr i64 BLOCK = 512;             // records that are processed together
constexpr i64 OFTEN = 1 << 14;         // records between two polls for Ctrl-C

// The states of Python's `atis_walk` and `atis_decode`, in the same order.
struct Walk {
    i64 overflow, last, first, falls, right, bottom, markers, records, damaged, damage;
};
struct Decoding {
    i64 overflow, records, damaged, damage;
};

i64 time_at(Span<const u8> raw, i64 i) {
    return i64(raw[SIZE * i + 2] & 0x7F) << 16 | i64(raw[SIZE * i + 3]) << 8 | raw[SIZE * i + 4];
}

// Records as words of which five bytes are valid, so that loops over them are vectorized.
void gather(Span<const u8> raw, i64 from, Span<u64> words) {
    // the last record of the file may have only five bytes
    i64 wide = std::min(words.size(), raw.size() / SIZE - 1 - from);
    for (i64 i = 0; i < wide; ++i) words[i] = word_at<u64>(raw, SIZE * (from + i));
    for (i64 i = wide; i < words.size(); ++i)
        words[i] = word_at<u32>(raw, SIZE * (from + i)) | u64(raw[SIZE * (from + i) + 4]) << 32;
}

i64 time_of(u64 word) { return i64((word >> 32 & 0xFF) | (word >> 16 & 0xFF00) | (word & 0x7F0000)); }

// Largest x and y of some records, and the number of decreases of time.
struct Summary {
    i32 right = 0, bottom = 0;
    i64 falls = 0;
};

NVSDATA_INLINE void summarize(Span<const u64> words, Summary* out) {
    i32 right = 0, bottom = 0, falls = 0;
    for (i64 i = 1; i < words.size(); ++i) {
        right = std::max(right, i32(words[i] & 0xFF));
        bottom = std::max(bottom, i32(words[i] >> 8 & 0xFF));
        falls += i32(time_of(words[i])) < i32(time_of(words[i - 1]));
    }
    *out = {std::max(out->right, right), std::max(out->bottom, bottom), out->falls + falls};
}

Summary summary(Span<const u8> raw) {
    alignas(64) u64 room[BLOCK + 8];
    u64* words = room + 7;  // the previous record (at first one of time 0), and the others from an aligned address on
    words[0] = 0;
    Summary found;
    for (i64 from = 0, size = raw.size() / SIZE; from < size; from += BLOCK) {
        i64 some = std::min(BLOCK, size - from);
        gather(raw, from, {words + 1, some});
        best<summarize>(Span<const u64>(words, some + 1), &found);
        words[0] = words[some];
    }
    return found;
}

void walk_with_markers(Span<const u8> raw, i64 block, Walk& walk, Span<i64> times, Rows<i64> offsets) {
    for (i64 i = 0; i < raw.size() / SIZE; ++i) {
        i64 record = walk.records + i, y = raw[SIZE * i + 1];
        // the time in an overflow record has no meaning
        i64 time = y >= MARKER_Y ? walk.last : plus(time_at(raw, i), walk.overflow);
        if (record % block == 0) times[record / block] = time, offsets(record / block, 0) = walk.overflow;
        if (y == MARKER_Y) {
            walk.overflow = plus(walk.overflow, MARKER_US);
            ++walk.markers;
        } else if (y > MARKER_Y) {
            if (walk.damaged++ == 0) walk.damage = record;
        } else {
            if (record == plus(walk.markers, walk.damaged)) walk.first = walk.last = time;
            walk.falls += time < walk.last;
            walk.last = time;
            walk.right = std::max(walk.right, i64(raw[SIZE * i]) + 1);
            walk.bottom = std::max(walk.bottom, y + 1);
        }
    }
}

}  // namespace

void atis_walk(Span<const u8> raw, i64 block, Span<i64> state, Span<i64> times, Rows<i64> offsets) {
    Walk walk = load<Walk>(state);
    i64 n = raw.size() / SIZE, next = to_next_block(walk.records, block);
    u64 after = u64(walk.records) + u64(n);
    i64 places = offsets.columns() == 1 ? std::min(times.size(), offsets.rows()) : 0;
    require(n == 0 || (after - 1) / u64(block) < u64(places), "more blocks than places for their times and offsets");
    Summary found = summary(raw);
    if (found.bottom >= MARKER_Y) {
        walk_with_markers(raw, block, walk, times, offsets);
    } else if (n) {
        // the usual piece
        for (u64 i = u64(next); i < u64(n); i += u64(block)) {
            i64 place = (walk.records + i64(i)) / block;
            times[place] = plus(time_at(raw, i64(i)), walk.overflow);
            offsets(place, 0) = walk.overflow;
        }
        i64 first = plus(time_at(raw, 0), walk.overflow);
        if (walk.records == plus(walk.markers, walk.damaged)) walk.first = walk.last = first;
        walk.falls += found.falls + (first < walk.last);
        walk.last = plus(time_at(raw, n - 1), walk.overflow);
        walk.right = std::max(walk.right, i64(found.right) + 1);
        walk.bottom = std::max(walk.bottom, i64(found.bottom) + 1);
    }
    walk.records = i64(after);
    store(walk, state);
}

namespace {

// Decode words as if all were events within the sensor; set `has_invalid` if one isn't.
NVSDATA_INLINE void decode_words(Span<const u64> words, i64 offset, i32 right, i32 bottom, Columns out,
                                 int* has_invalid) {
    int outside = 0;
    for (i64 i = 0; i < words.size(); ++i) {
        u64 word = words[i];
        i32 x = word & 0xFF, y = word >> 8 & 0xFF;
        outside |= (x >= right) | (y >= bottom);
        out.t[i] = plus(time_of(word), offset);
        out.x[i] = i16(x);
        out.y[i] = i16(y);
        out.p[i] = word >> 23 & 1;
    }
    *has_invalid |= outside;
}

// Decode records as if all were events within the sensor; returns false if one isn't.
bool decode_events(Span<const u8> raw, i64 offset, i32 right, i32 bottom, const Columns& out) {
    alignas(64) u64 words[BLOCK];
    int has_invalid = 0;
    for (i64 from = 0; from < out.t.size(); from += BLOCK) {
        i64 to = std::min(from + BLOCK, out.t.size());
        gather(raw, from, {words, to - from});
        best<decode_words>(Span<const u64>(words, to - from), offset, right, bottom, out.part(from, to), &has_invalid);
    }
    return !has_invalid;
}

}  // namespace

Found atis_decode(Span<const u8> raw, i64 width, i64 height, Span<i64> state, i64 kept, Span<i64> t, Span<i16> x,
                  Span<i16> y, Span<u8> p) {
    Decoding done = load<Decoding>(state);
    i64 size = raw.size() / SIZE, begin = done.records;
    Columns out(t, x, y, p, kept, size);
    i64 right = std::clamp<i64>(width, 0, 256), bottom = std::clamp<i64>(height, 0, MARKER_Y);
    done.records = plus(begin, size);
    if (decode_events(raw, done.overflow, i32(right), i32(bottom), out)) {
        store(done, state);
        return {size, -1};
    }
    i64 count = 0, bad = -1;
    for (i64 i = 0; i < size; ++i) {
        i64 column = raw[SIZE * i], row = raw[SIZE * i + 1];
        if (row == MARKER_Y) {
            done.overflow = plus(done.overflow, MARKER_US);
        } else if (row > MARKER_Y) {
            if (done.damaged++ == 0) done.damage = plus(begin, i);
        } else {
            if ((column >= right || row >= bottom) && bad < 0) bad = i;
            out.t[count] = plus(time_at(raw, i), done.overflow);
            out.x[count] = i16(column);
            out.y[count] = i16(row);
            out.p[count++] = raw[SIZE * i + 2] >> 7;
        }
    }
    store(done, state);
    return {count, bad};
}

i64 atis_encode(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 offset, Span<u8> out) {
    Events(t, x, y, p);  // equally long
    Interrupt interrupt;
    i64 at = 0;
    for (i64 i = 0; i < t.size();) {
        if (i % OFTEN == 0) interrupt.poll();
        require(out.size() - at >= SIZE, "events are not sorted by time");
        bool marker = minus(t[i], offset) >= FULL_US;
        u32 place = marker ? u32(MARKER_Y) << 8 : u32(u8(x[i])) | u32(u8(y[i])) << 8;
        u32 rest = marker ? u32(FULL_US - 1) : u32(p[i]) << 23 | u32(minus(t[i], offset));
        u32 word = place | (rest & 0xFF0000) | (rest & 0xFF00) << 16;
        std::memcpy(&out[at], &word, sizeof word);
        out[at + 4] = u8(rest);
        at += SIZE;
        offset = plus(offset, marker ? MARKER_US : 0);
        i += !marker;
    }
    return offset;
}

void define_atis(nb::module_& module) {
    define<atis_walk>(module, "atis_walk");
    define<atis_decode>(module, "atis_decode");
    define<atis_encode>(module, "atis_encode");
}

}  // namespace nvsdata
