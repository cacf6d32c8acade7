// Bit operations that C++20 has in <bit>.
#pragma once

#ifdef _MSC_VER
#include <intrin.h>
#endif

#include "span.h"

namespace nvsdata {

// Place of the lowest bit of a word that isn't 0.
inline int trailing_zeros(u64 word) {
#ifdef _MSC_VER
    unsigned long place;
    _BitScanForward64(&place, word);
    return int(place);
#else
    return __builtin_ctzll(word);
#endif
}

}  // namespace nvsdata
