// Arithmetic of times from a caller: overflow of int64 wraps, whereas in C++ it is undefined.
#pragma once

#include "span.h"

namespace nvsdata {

inline i64 plus(i64 a, i64 b) { return i64(u64(a) + u64(b)); }
inline i64 minus(i64 a, i64 b) { return i64(u64(a) - u64(b)); }
inline i64 times(i64 a, i64 b) { return i64(u64(a) * u64(b)); }

// The difference of two times.
inline i64 gap(i64 a, i64 b) {
    i64 difference = minus(a, b);
    return difference < 0 ? minus(0, difference) : difference;
}

// Rounded down; b > 0.
inline i64 floor_divide(i64 a, i64 b) { return a / b - (a % b < 0); }

}  // namespace nvsdata
