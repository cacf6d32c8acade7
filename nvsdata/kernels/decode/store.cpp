// Windows of stored columns.
#include <algorithm>
#include <memory>
#include <utility>
#include <variant>

#include "../native/bind.h"
#include "../native/files.h"
#include "../native/interrupt.h"
#include "../native/levels.h"
#include "clock.h"
#include "columns.h"

namespace nvsdata {

namespace {

constexpr i64 PIECE = 1 << 20;  // bytes that are read at once

using Times = std::variant<Span<const u32>, Span<const i64>>;
using Places = std::variant<Span<const u8>, Span<const u16>>;

// First index in `t` whose time is at least `time`; if they aren't in order, some index.
template <class Time>
i64 bisect(Span<const Time> t, i64 base, i64 time) {
    i64 low = 0, high = t.size();
    while (low < high) {
        i64 middle = (low + high) / 2;
        if (plus(i64(t[middle]), base) < time)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

template <class Time>
NVSDATA_INLINE void add(const Time* from, i64 base, i64* to, i64 size) {
    for (i64 i = 0; i < size; ++i) to[i] = plus(i64(from[i]), base);
}

template <class From, class To>
NVSDATA_INLINE void convert(const From* from, To* to, i64 size) {
    for (i64 i = 0; i < size; ++i) to[i] = To(from[i]);
}

// Write the times from `start` up to `stop`, with `base` added; `t` may overlap the output. Returns the index
// of the first one, and their number.
template <class Time>
std::pair<i64, i64> times_between(Span<const Time> t, i64 base, i64 start, i64 stop, Span<i64> out) {
    i64 first = bisect(t, base, start), count = std::max(bisect(t, base, stop) - first, i64(0));
    best<add<Time>>(t.part(first, first + count).data(), base, out.part(0, count).data(), count);
    return {first, count};
}

template <class From, class To>
void copy(Span<const From> in, Span<To> out) {
    best<convert<From, To>>(in.part(0, out.size()).data(), out.data(), out.size());
}

// A column of an open file.
struct Stored {
    int handle;
    i64 begin;  // byte of the first item
    int width;  // bytes of an item
    // byte of an item; unsigned, because the argument has no bounds
    i64 byte(i64 item) const { return i64(u64(begin) + u64(item) * u64(width)); }
};

// Fill `out` with items from `first` on. Returns false if the file has fewer.
template <class Item>
bool read_items(const Stored& column, i64 first, Span<Item> out, Interrupt& interrupt) {
    Span<u8> bytes(reinterpret_cast<u8*>(out.data()), out.size() * i64(sizeof(Item)));
    for (i64 i = 0; i < bytes.size(); i += PIECE) {
        if (i) interrupt.poll();
        Span<u8> piece = bytes.part(i, std::min(i + PIECE, bytes.size()));
        if (!read_at(column.handle, plus(column.byte(first), i), piece)) return false;
    }
    return true;
}

// Fill `out` with coordinates of one byte or two from item `first` on. Returns false if the file has fewer.
bool read_places(const Stored& column, i64 first, Span<i16> out, Interrupt& interrupt) {
    // uint16 have the same bits
    if (column.width == 2) return read_items(column, first, out, interrupt);
    require(column.width == 1, "coordinates have one or two bytes");
    std::unique_ptr<u8[]> memory(new u8[std::size_t(std::min(out.size(), PIECE))]);
    for (i64 i = 0; i < out.size(); i += PIECE) {
        if (i) interrupt.poll();
        Span<u8> piece(memory.get(), std::min(out.size() - i, PIECE));
        if (!read_items(column, plus(first, i), piece, interrupt)) return false;
        copy(Span<const u8>(piece), out.part(i, i + piece.size()));
    }
    return true;
}

}  // namespace

template <class Time>
std::pair<i64, i64> marked_range(Span<const Time> marks, i64 base, i64 start, i64 stop) {
    i64 first = std::max(bisect(marks, base, start) - 1, i64(0));
    return {first, std::max(bisect(marks, base, stop), first)};
}

i64 read_window(Span<i64> out_t, Span<i16> out_x, Span<i16> out_y, Span<u8> out_p, i64 base, i64 start, i64 stop,
                int handle, i64 lo, i64 t0, i64 x0, i64 y0, i64 p0, int t_width, int x_width, int y_width) {
    i64 room = out_t.size();
    Columns out(out_t, out_x, out_y, out_p, 0, room);
    Stored t{handle, t0, t_width}, x{handle, x0, x_width}, y{handle, y0, y_width}, p{handle, p0, 1};
    Interrupt interrupt;
    std::pair<i64, i64> found;
    if (t_width == 8) {
        if (!read_items(t, lo, out.t, interrupt)) return -1;
        found = times_between(Span<const i64>(out.t), base, start, stop, out.t);
    } else {
        require(t_width == 4, "times have four or eight bytes");
        std::unique_ptr<u32[]> memory(new u32[std::size_t(room)]);
        Span<u32> times(memory.get(), room);
        if (!read_items(t, lo, times, interrupt)) return -1;
        found = times_between(Span<const u32>(times), base, start, stop, out.t);
    }
    auto [first, count] = found;
    first = plus(first, lo);
    bool whole = read_places(x, first, out.x.part(0, count), interrupt) &&
                 read_places(y, first, out.y.part(0, count), interrupt) &&
                 read_items(p, first, out.p.part(0, count), interrupt);
    return whole ? count : -1;
}

i64 stored_window(Span<i64> out_t, Span<i16> out_x, Span<i16> out_y, Span<u8> out_p, i64 base, i64 start, i64 stop,
                  Times t, Places x, Places y, Span<const u8> p) {
    auto size = [](auto column) { return column.size(); };
    i64 room = std::visit(size, t);
    require(std::visit(size, x) == room && std::visit(size, y) == room && p.size() == room,
            "columns of different lengths");
    Columns out(out_t, out_x, out_y, out_p, 0, room);
    auto between = [&](auto times) { return times_between(times, base, start, stop, out.t); };
    auto [first, count] = std::visit(between, t);
    auto copy_found = [first = first, count = count](auto from, auto to) {
        copy(from.part(first, first + count), to.part(0, count));
    };
    std::visit([&](auto places) { copy_found(places, out.x); }, x);
    std::visit([&](auto places) { copy_found(places, out.y); }, y);
    copy_found(p, out.p);
    return count;
}

void define_store(nb::module_& module) {
    define<marked_range<u32>, marked_range<i64>>(module, "marked_range");
    define<read_window>(module, "read_window");
    define<stored_window>(module, "stored_window");
}

}  // namespace nvsdata
