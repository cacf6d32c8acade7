// The nearest events of each event: see neighbors.py.
#pragma once

#include "../native/span.h"

namespace nvsdata {

constexpr i64 SWEEP = 48;  // mean number of events near in time up to which testing all of them is fastest
constexpr i64 MIXED = 3;   // factor of this number if differences in time can change the order of distances in space

// `degree` gets the number of sources of each event. The rows of `source` have room for one index more. Returns the
// number of all edges.
template <class Coordinate>
i64 near_sources(Span<const i64> t, Span<const Coordinate> x, Span<const Coordinate> y, double radius, double alpha,
                 double beta, i64 sweep_below, Span<i32> degree, Rows<i32> source);

extern template i64 near_sources<i16>(Span<const i64>, Span<const i16>, Span<const i16>, double, double, double, i64,
                                      Span<i32>, Rows<i32>);

}  // namespace nvsdata
