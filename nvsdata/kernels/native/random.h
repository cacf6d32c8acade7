// Random bits that depend only on a number (splitmix64, Steele et al. 2014).
#pragma once

#include "span.h"

namespace nvsdata {

constexpr u64 step = 0x9E3779B97F4A7C15;  // from one state to the next; odd, of well-mixed bits, as the two below

inline u64 random_bits(u64 state) {
    u64 z = (state ^ (state >> 30)) * 0xBF58476D1CE4E5B9;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB;
    return z ^ (z >> 31);
}

}  // namespace nvsdata
