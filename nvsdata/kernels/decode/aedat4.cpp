// Events of AEDAT 4 to columns.
#include <algorithm>

#include "../native/bind.h"
#include "../native/levels.h"
#include "../native/require.h"
#include "../native/times.h"
#include "columns.h"

namespace nvsdata {

namespace {

constexpr i64 BLOCK = 512;  // events whose columns are in the cache while they are checked

// The largest values of columns, coordinates as unsigned ones; `strays` has bit 63 if a time is out of range.
struct Largest {
    u64 strays;
    u16 x, y;
    u8 p;
};

NVSDATA_INLINE void write_columns(const i64* words, u64 last, Columns out, Largest* largest) {
    i64* t = out.t.data();
    i16 *x = out.x.data(), *y = out.y.data();
    u8* p = out.p.data();
    u64 strays = 0;
    u16 right = 0, bottom = 0;
    u8 on = 0;
    i64 size = out.t.size();
    for (i64 begin = 0; begin < size; begin += BLOCK) {
        i64 end = std::min(begin + BLOCK, size);
        for (i64 i = begin; i < end; ++i) {
            u64 time = u64(words[2 * i]), rest = u64(words[2 * i + 1]);
            // differences, because comparisons of 64 bits can't be vectorized on all processors; if one difference
            // wraps, the other is negative
            strays |= (last - time) | (last + time);
            t[i] = i64(time);
            x[i] = i16(rest);
            y[i] = i16(rest >> 16);
            p[i] = u8(rest >> 32);
        }
        for (i64 i = begin; i < end; ++i) right = std::max(right, u16(x[i]));
        for (i64 i = begin; i < end; ++i) bottom = std::max(bottom, u16(y[i]));
        for (i64 i = begin; i < end; ++i) on = std::max(on, p[i]);
    }
    *largest = {strays, right, bottom, on};
}

}  // namespace

bool aedat4_decode(Span<const i64> words, i64 latest, i64 width, i64 height, Span<i64> t, Span<i16> x, Span<i16> y,
                   Span<u8> p) {
    require(latest >= 1 && latest <= LATEST, "times are at most 2^62");
    require(words.size() % 2 == 0, "an event has two words");
    i64 size = words.size() / 2;
    if (size == 0) return true;
    // in `write_columns`, no index reaches `size`
    Columns out(t, x, y, p, 0, size);
    Largest largest;
    best<write_columns>(words.data(), u64(latest) - 1, out, &largest);
    return largest.strays >> 63 == 0 && largest.x < width && largest.y < height && largest.p <= 1;
}

void define_aedat4(nb::module_& module) { define<aedat4_decode>(module, "aedat4_decode"); }

}  // namespace nvsdata
