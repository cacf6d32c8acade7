// Checks of the arguments of a function.
#pragma once

#include <stdexcept>

namespace nvsdata {

// Raises ValueError unless a condition holds.
inline void require(bool holds, const char* what) {
    if (!holds) throw std::invalid_argument(what);
}

}  // namespace nvsdata
