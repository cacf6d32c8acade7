// Bounds of times.
#pragma once

#include "span.h"

namespace nvsdata {

// Times of events are between this and its negative, both excluded, so that differences can't overflow.
constexpr i64 LATEST = i64(1) << 62;  // µs

}  // namespace nvsdata
