// Arithmetic of times that a caller may choose: what is beyond int64 wraps, where C++ leaves it undefined.
#pragma once

#include "span.h"

namespace nvsdata {

inline i64 plus(i64 a, i64 b) { return i64(u64(a) + u64(b)); }
inline i64 minus(i64 a, i64 b) { return i64(u64(a) - u64(b)); }
inline i64 times(i64 a, i64 b) { return i64(u64(a) * u64(b)); }

// How far two times are apart.
inline i64 gap(i64 a, i64 b) {
    i64 difference = minus(a, b);
    return difference < 0 ? minus(0, difference) : difference;
}

// Rounded down; b > 0.
inline i64 floor_divide(i64 a, i64 b) { return a / b - (a % b < 0); }

}  // namespace nvsdata
