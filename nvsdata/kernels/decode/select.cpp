// Events chosen by a mask or by indices.
#include <algorithm>

#include "../native/bind.h"
#include "../native/interrupt.h"
#include "events.h"

namespace nvsdata {

void copy_where(Span<const bool> keep, Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p,
                Span<i64> to_t, Span<i16> to_x, Span<i16> to_y, Span<u8> to_p) {
    Events from{t, x, y, p};
    i64 room = to_t.size();
    Columns to{to_t, to_x, to_y, to_p, 0, room};
    require(keep.size() == from.size(), "the mask must be as long as the columns");
    // bytes, because an array that was viewed as bool may have any bytes
    Span<const u8> bytes(reinterpret_cast<const u8*>(keep.data()), keep.size());
    i64 kept = 0;
    for (i64 i = 0; i < from.size() && kept < room;)
        // as many as fit if all are kept; without a branch: events that aren't kept are overwritten
        for (i64 stop = std::min(from.size(), i + room - kept); i < stop; ++i) {
            from.copy(i, to, kept);
            kept += bytes[i] != 0;
        }
}

template <class Index>
void copy_at(Span<const Index> index, Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p,
             Span<i64> to_t, Span<i16> to_x, Span<i16> to_y, Span<u8> to_p) {
    constexpr i64 BLOCK = 1 << 16;
    Events from{t, x, y, p};
    Columns to{to_t, to_x, to_y, to_p, 0, index.size()};
    Interrupt interrupt;
    for (i64 start = 0; start < index.size(); start += BLOCK) {
        interrupt.poll();
        for (i64 i = start; i < std::min(start + BLOCK, index.size()); ++i) {
            if (u64(index[i]) >= u64(from.size())) throw std::out_of_range("an index of no event");
            from.copy(index[i], to, i);
        }
    }
}

void define_select(nb::module_& module) {
    define<copy_where>(module, "copy_where");
    define<copy_at<i32>, copy_at<i64>>(module, "copy_at");
}

}  // namespace nvsdata
