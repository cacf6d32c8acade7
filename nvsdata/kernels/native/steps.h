// Steps from a pixel to those around it.
#pragma once

#include <algorithm>
#include <tuple>

#include "vector.h"

namespace nvsdata {

struct Step {
    i64 square, dy, dx;  // squared length
    bool operator<(const Step& other) const {
        return std::tie(square, dy, dx) < std::tie(other.square, other.dy, other.dx);
    }
};

// Steps of up to `reach` pixels along each axis whose squared length is `near`, nearest first, then row by row.
template <class IsNear>
Vector<Step> steps_around(i64 reach, IsNear is_near) {
    Vector<Step> steps;
    for (i64 dy = -reach; dy <= reach; ++dy)
        for (i64 dx = -reach; dx <= reach; ++dx)
            if (i64 square = dx * dx + dy * dy; is_near(square)) steps.push_back({square, dy, dx});
    std::sort(steps.begin(), steps.end());
    return steps;
}

}  // namespace nvsdata
