// std::vector, whose indexes are checked and counted as those of spans are.
#pragma once

#include <vector>

#include "span.h"

namespace nvsdata {

template <class T>
class Vector : public std::vector<T> {
public:
    using std::vector<T>::vector;

    T& operator[](u64 i) {
        check_index(i, this->size());
        return std::vector<T>::operator[](i);
    }
    const T& operator[](u64 i) const {
        check_index(i, this->size());
        return std::vector<T>::operator[](i);
    }
};

}  // namespace nvsdata
