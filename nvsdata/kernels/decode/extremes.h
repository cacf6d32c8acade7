// The lowest and the highest time.
#pragma once

#include <algorithm>

#include "../native/levels.h"
#include "../native/span.h"

namespace nvsdata {

// There must be at least one time.
NVSDATA_INLINE void find_extremes(Span<const i64> t, i64* lowest, i64* highest) {
    i64 low = t[0], high = t[0];
    for (i64 i = 1; i < t.size(); ++i) low = std::min(low, t[i]), high = std::max(high, t[i]);
    *lowest = low, *highest = high;
}

}  // namespace nvsdata
