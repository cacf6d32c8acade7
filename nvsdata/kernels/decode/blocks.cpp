// Records of a packed store: a head, a table of blocks, and blocks of the columns t, x, y and p (docs/dev/store.md).
#include <algorithm>
#include <limits>
#include <tuple>
#include <utility>

#include "../native/bind.h"
#include "../native/crc32c.h"
#include "../native/interrupt.h"
#include "../native/levels.h"
#include "clock.h"
#include "columns.h"

namespace nvsdata {

namespace {

enum Fault : i64 { CHECKSUM = 1, OUTSIDE, DISORDER, OTHER_TIMES };
enum Damage : i64 { CUT = 1, ALTERED, CONTRADICTS };

constexpr i64 HEAD = 72, ENTRY = 24;     // bytes of a head, and of a block in the table
constexpr i64 MOST_EVENTS = 1 << 16;     // of a block
constexpr i64 MOST_RATIO = 100;          // bytes of events for a byte of a compressed block
constexpr i64 ALIGNED = 8;               // records begin at multiples
constexpr i64 UNSTATED = std::numeric_limits<i64>::min();
constexpr i64 MOST_SIDE = 32767;         // pixels

// A block in the table of a record.
struct Entry {
    i64 first;  // time of the first event since that of the recording, in µs
    u32 events, bytes, check, zero;
};
static_assert(sizeof(Entry) == ENTRY);

struct Head {
    u32 check, blocks;
    u64 events;
    i64 base, duration, begin, end;
    u16 width, height;
    u8 t_width, xy_width, compressed, guessed;
};
static_assert(sizeof(Head) == HEAD - 16);  // the name of a format follows

// An item of a column at any address.
template <class Item>
NVSDATA_INLINE Item item_at(const u8* column, i64 i) {
    Item item;
    std::memcpy(&item, column + i * i64(sizeof(Item)), sizeof item);
    return item;
}

template <class Item>
NVSDATA_INLINE void convert_times(const u8* column, i64 base, i64* out, i64 size) {
    for (i64 i = 0; i < size; ++i) out[i] = plus(i64(item_at<Item>(column, i)), base);
}

// Copy coordinates; returns the largest one.
template <class Item>
NVSDATA_INLINE i64 convert_places(const u8* column, i16* out, i64 size) {
    u16 most = 0;
    for (i64 i = 0; i < size; ++i) {
        u16 place = item_at<Item>(column, i);
        most = std::max(most, place);
        out[i] = i16(place);
    }
    return most;
}

NVSDATA_INLINE i64 copy_bytes(const u8* column, u8* out, i64 size) {
    u8 most = 0;
    for (i64 i = 0; i < size; ++i) {
        most = std::max(most, column[i]);
        out[i] = column[i];
    }
    return most;
}

NVSDATA_INLINE bool in_order(const i64* t, i64 size) {
    bool fine = true;
    for (i64 i = 1; i < size; ++i) fine &= t[i - 1] <= t[i];
    return fine;
}

// The first of `size` times that is at least `time`; if they aren't in order, some index.
template <class Item>
i64 bisect(const u8* column, i64 size, i64 base, i64 time) {
    i64 low = 0, high = size;
    while (low < high) {
        i64 middle = (low + high) / 2;
        if (plus(i64(item_at<Item>(column, middle)), base) < time)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

struct Kind {
    int t_width, xy_width;
    i64 bytes() const { return t_width + 2 * xy_width + 1; }  // of an event
};

i64 bisect(const u8* column, i64 size, i64 base, i64 time, int width) {
    return width == 8 ? bisect<i64>(column, size, base, time) : bisect<u32>(column, size, base, time);
}

i64 places(const u8* column, i16* out, i64 size, int width) {
    return width == 2 ? best<convert_places<u16>>(column, out, size) : best<convert_places<u8>>(column, out, size);
}

}  // namespace

// What the head of a record states; `damage` is 0 if it is sound.
using Stated = std::tuple<i64, i64, i64, i64, i64, i64, i64, i64, int, int, int>;

Stated damaged(Damage kind) { return {kind, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}; }

// Returns 0 or a kind of damage, and what the head of a record of `room` bytes states. `raw` has its first bytes.
Stated record_head(Span<const u8> raw, i64 room) {
    if (raw.size() < HEAD || room < HEAD) return damaged(CUT);
    auto head = word_at<Head>(raw, 0);
    i64 size = HEAD + ENTRY * i64(head.blocks);
    if (size > room || size > raw.size()) return damaged(CUT);
    if (crc32c(raw.part(4, size)) != head.check) return damaged(ALTERED);
    i64 each = i64(head.t_width) + 2 * i64(head.xy_width) + 1, events = 0, bytes = 0, before = 0;
    bool fine = head.blocks > 0 && (head.t_width == 4 || head.t_width == 8) &&
                (head.xy_width == 1 || head.xy_width == 2) && head.compressed <= 1 && head.guessed <= 1 && head.width > 0 &&
                head.width <= MOST_SIDE && head.height > 0 && head.height <= MOST_SIDE && head.base > -LATEST &&
                head.base < LATEST && head.duration >= 0 && head.duration < LATEST - head.base;
    bool stated = head.begin != UNSTATED || head.end != UNSTATED;
    fine &= !stated || (head.begin > -LATEST && head.begin <= head.base && head.end < LATEST &&
                        head.end >= plus(head.base, head.duration));
    for (i64 k = 0; k < i64(head.blocks); ++k) {
        auto entry = word_at<Entry>(raw, HEAD + ENTRY * k);
        i64 whole = i64(entry.events) * each;
        events += i64(entry.events);
        bytes += i64(entry.bytes);
        fine &= entry.events > 0 && entry.events <= MOST_EVENTS;
        fine &= entry.first >= before && entry.first <= head.duration;
        fine &= head.compressed ? i64(entry.bytes) * MOST_RATIO >= whole : i64(entry.bytes) == whole;
        fine &= k > 0 || entry.first == 0;
        before = entry.first;
    }
    fine &= u64(events) == head.events && bytes <= room - size && room - size - bytes < ALIGNED;
    if (!fine) return damaged(CONTRADICTS);
    return {0,          head.blocks, head.base,    head.duration, head.begin,     head.end,
            head.width, head.height, head.t_width, head.xy_width, head.compressed};
}

// Returns the first block of a table that may have events with start <= t < stop, the block after the last one, where
// their bytes begin and end after the table, and the number of their events.
std::tuple<i64, i64, i64, i64, i64> blocks_between(Span<const u8> table, i64 base, i64 start, i64 stop) {
    i64 count = table.size() / ENTRY, first = 0, last = 0, begin = 0, end = 0, events = 0;
    for (i64 k = 0; k < count; ++k) {
        auto entry = word_at<Entry>(table, ENTRY * k);
        i64 time = plus(entry.first, base);
        if (time >= stop) break;
        // equal times may begin in the block before
        if (time < start) {
            first = k;
            begin = end;
            events = 0;
        }
        last = k + 1;
        end += i64(entry.bytes);
        events += i64(entry.events);
    }
    return {first, last, begin, end, events};
}

// Returns the number of events in the window, and 0 or the fault of block k as 4 k + fault.
std::pair<i64, i64> unpack_blocks(Span<i64> out_t, Span<i16> out_x, Span<i16> out_y, Span<u8> out_p, i64 base,
                                  i64 start, i64 stop, Span<const u8> raw, Span<const u8> table, int check,
                                  int t_width, int xy_width, i64 width, i64 height) {
    require((t_width == 4 || t_width == 8) && (xy_width == 1 || xy_width == 2), "widths other than 4 or 8, 1 or 2");
    Kind kind{t_width, xy_width};
    i64 blocks = table.size() / ENTRY, all = 0;
    for (i64 k = 0; k < blocks; ++k) {
        i64 events = word_at<Entry>(table, ENTRY * k).events;
        require(events <= MOST_EVENTS, "a block of too many events");
        all += events;
    }
    require(all * kind.bytes() == raw.size(), "bytes of another number of events");
    Columns out(out_t, out_x, out_y, out_p, 0, all);
    Interrupt interrupt;
    i64 found = 0, at = 0;
    for (i64 k = 0; k < blocks; ++k) {
        interrupt.poll();
        auto entry = word_at<Entry>(table, ENTRY * k);
        i64 count = i64(entry.events);
        Span<const u8> block = raw.part(at, at + count * kind.bytes());
        at += block.size();
        if (check && crc32c(block) != entry.check) return {0, 4 * k + CHECKSUM};
        const u8* t = block.data();
        if (count && (t_width == 8 ? item_at<i64>(t, 0) : i64(item_at<u32>(t, 0))) != entry.first)
            return {0, 4 * k + OTHER_TIMES};
        i64 first = bisect(t, count, base, start, t_width);
        i64 size = std::max(bisect(t, count, base, stop, t_width) - first, i64(0));
        count_touched(block.size());
        Columns own = out.part(found, found + size);
        if (t_width == 8)
            best<convert_times<i64>>(t + first * 8, base, own.t.data(), size);
        else
            best<convert_times<u32>>(t + first * 4, base, own.t.data(), size);
        const u8 *x = t + count * t_width, *y = x + count * xy_width, *p = y + count * xy_width;
        bool inside = places(x + first * xy_width, own.x.data(), size, xy_width) < width || !size;
        inside &= places(y + first * xy_width, own.y.data(), size, xy_width) < height || !size;
        inside &= best<copy_bytes>(p + first, own.p.data(), size) <= 1;
        if (!inside) return {0, 4 * k + OUTSIDE};
        // with the last event of the block before
        i64 from = std::max(found - 1, i64(0));
        if (!best<in_order>(out.t.data() + from, found + size - from)) return {0, 4 * k + DISORDER};
        found += size;
    }
    return {found, 0};
}

u32 checksum_of(Span<const u8> bytes) { return crc32c(bytes); }

void define_blocks(nb::module_& module) {
    define<record_head>(module, "record_head");
    define<blocks_between>(module, "blocks_between");
    define<unpack_blocks>(module, "unpack_blocks");
    define<checksum_of>(module, "crc32c");
}

}  // namespace nvsdata
