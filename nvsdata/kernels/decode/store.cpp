// Windows of the columns of a store of the second layout.
#include <algorithm>
#include <utility>
#include <variant>

#include "../native/bind.h"
#include "../native/levels.h"
#include "clock.h"
#include "columns.h"

namespace nvsdata {

namespace {

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

}  // namespace

template <class Time>
std::pair<i64, i64> marked_range(Span<const Time> marks, i64 base, i64 start, i64 stop) {
    i64 first = std::max(bisect(marks, base, start) - 1, i64(0));
    return {first, std::max(bisect(marks, base, stop), first)};
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
    define<stored_window>(module, "stored_window");
}

}  // namespace nvsdata
