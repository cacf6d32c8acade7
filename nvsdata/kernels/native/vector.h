// std::vector, whose indexes are checked and counted as those of spans are.
#pragma once

#include <memory>
#include <vector>

#include "span.h"

namespace nvsdata {

template <class T, class Memory = std::allocator<T>>
class Vector : public std::vector<T, Memory> {
public:
    using std::vector<T, Memory>::vector;

    T& operator[](u64 i) {
        check_index(i, this->size());
        return std::vector<T, Memory>::operator[](i);
    }
    const T& operator[](u64 i) const {
        check_index(i, this->size());
        return std::vector<T, Memory>::operator[](i);
    }
};

}  // namespace nvsdata
