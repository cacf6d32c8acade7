// Checks of arrays of indexes.
#pragma once

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <type_traits>

#include "span.h"

namespace nvsdata {

// std::out_of_range, which Python sees as IndexError, unless all are in 0..count - 1.
template <class Integer>
void check_below(Span<const Integer> values, i64 count, const char* message) {
    using Unsigned = std::make_unsigned_t<Integer>;
    // if no value is allowed (count <= 0), `most` is -1, whose sign bit is set, so every value is refused below
    i64 most = std::min(std::max(count, i64(0)) - 1, i64(std::numeric_limits<Integer>::max()));
    Unsigned last = Unsigned(most), signs = 0;
    // the sign bit of at least one of the two terms is set if a value is out of range
    for (Integer value : values) signs |= Unsigned(value) | Unsigned(last - Unsigned(value));
    if (Integer(signs) < 0) throw std::out_of_range(message);
}

}  // namespace nvsdata
