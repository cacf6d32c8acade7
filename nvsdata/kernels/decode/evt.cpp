// Words of time that an EVT file needs; see evt.py.
#include "evt.h"

#include "../native/bind.h"

namespace nvsdata {

i64 count_shown(Span<const i64> t, i64 before, int bits, int shift) {
    // with one bit, no word would be between the beginning and the end of a wrap
    require(1 < bits && bits < 62 && 0 <= shift && shift < 62, "a counter of 2 to 61 bits");
    constexpr i64 BLOCK = 64;
    i64 count = 0;
    for (i64 from = 0; from < t.size(); from += BLOCK) {
        Span<const i64> some = t.part(from, std::min(from + BLOCK, t.size()));
        // usually no word is needed
        i64 other = 0;
        for (i64 time : some) other |= time >> shift ^ before;
        if (!other) continue;
        for (i64 time : some)
            for (; before != time >> shift; ++count) before = shown_next(before, time >> shift, bits);
    }
    return count;
}

void define_evt(nb::module_& module) { define<count_shown>(module, "count_shown"); }

}  // namespace nvsdata
