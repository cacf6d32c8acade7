// Edges of graphs, and their pseudo-coordinates.
#pragma once

#include <algorithm>
#include <cmath>

#include "../native/require.h"
#include "../native/span.h"

namespace nvsdata {

// The pseudo-coordinate of a difference from target to source, in units of the normalization range.
inline float pseudo_coordinate(float d, bool is_signed) {
    return is_signed ? std::min(std::max(d * 0.5f + 0.5f, 0.0f), 1.0f) : std::min(std::abs(d), 1.0f);
}

inline void require_edges(Span<const i64> source, Span<const i64> target, i64 rows) {
    require(source.size() == target.size() && source.size() == rows,
            "sources, targets and pseudo-coordinates of edges differ in number");
}

}  // namespace nvsdata
