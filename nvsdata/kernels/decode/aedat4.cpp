// Events of AEDAT 4 to columns.
#include "../native/bind.h"
#include "columns.h"

namespace nvsdata {

bool aedat4_decode(Span<const i64> words, i64 latest, i64 width, i64 height, Span<i64> t, Span<i16> x, Span<i16> y,
                   Span<u8> p) {
    i64 size = words.size() / 2;
    if (words.size() % 2) throw std::invalid_argument("an event has two words");
    if (latest < 1 || latest > i64(1) << 62) throw std::invalid_argument("times up to 2^62 at most");
    Columns columns(t, x, y, p, 0, size);
    // of differences that are negative for an invalid event: comparisons of 64 bits can't be vectorized everywhere
    u64 signs = 0, last = u64(latest) - 1, right = u64(width) - 1, bottom = u64(height) - 1;
    for (i64 i = 0; i < size; ++i) {
        u64 time = u64(words[2 * i]), rest = u64(words[2 * i + 1]);
        u64 column = rest & 0xFFFF, row = rest >> 16 & 0xFFFF, on = rest >> 32 & 0xFF;
        // of a time so far away that one of its differences wraps, the other one is negative
        signs |= (last - time) | (last + time) | (right - column) | (bottom - row) | (1 - on);
        columns.t[i] = i64(time);
        columns.x[i] = i16(column);
        columns.y[i] = i16(row);
        columns.p[i] = u8(on);
    }
    return signs >> 63 == 0;
}

void define_aedat4(nb::module_& module) { define<aedat4_decode>(module, "aedat4_decode"); }

}  // namespace nvsdata
