// Views of arrays: pointers with sizes. A build with NVSDATA_BOUNDS checks and counts every index.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

#ifdef NVSDATA_BOUNDS
#include <cstdio>
#include <cstdlib>
#endif

namespace nvsdata {

using i8 = std::int8_t;
using i16 = std::int16_t;
using i32 = std::int32_t;
using i64 = std::int64_t;
using u8 = std::uint8_t;
using u16 = std::uint16_t;
using u32 = std::uint32_t;
using u64 = std::uint64_t;

#ifdef NVSDATA_BOUNDS
// Number of elements that this thread has accessed; tests count these instead of measuring time.
inline thread_local u64 touched = 0;
#endif

// Also fails for negative numbers, which are converted to very large ones.
inline void check_index([[maybe_unused]] u64 i, [[maybe_unused]] u64 size) {
#ifdef NVSDATA_BOUNDS
    ++touched;
    if (i >= size) {
        std::fprintf(stderr, "nvsdata: index %lld of %llu\n", (long long)i, (unsigned long long)size);
        std::abort();
    }
#endif
}

// For loops of the standard library, which use no indexes.
inline void count_touched([[maybe_unused]] i64 n) {
#ifdef NVSDATA_BOUNDS
    touched += u64(n);
#endif
}

// One dimension, contiguous.
template <class T>
class Span {
public:
    Span() = default;
    Span(T* data, i64 size) : data_(data), size_(size) {}
    // from std::vector and its like
    template <class Values, class = decltype(static_cast<T*>(std::declval<Values&>().data()))>
    Span(Values& values) : data_(values.data()), size_(i64(values.size())) {}

    T& operator[](i64 i) const {
        check_index(u64(i), u64(size_));
        return data_[i];
    }
    i64 size() const { return size_; }
    bool empty() const { return size_ == 0; }
    T* data() const { return data_; }
    T* begin() const { return data_; }
    T* end() const { return data_ + size_; }
    T& back() const { return (*this)[size_ - 1]; }
    operator Span<const T>() const { return {data_, size_}; }

    // Values from `from` up to `to`.
    Span part(i64 from, i64 to) const {
        check_index(u64(from), u64(to) + 1);
        check_index(u64(to), u64(size_) + 1);
        return {data_ + from, to - from};
    }

private:
    T* data_ = nullptr;
    i64 size_ = 0;
};

// Two dimensions, contiguous, row by row.
template <class T>
class Rows {
public:
    Rows() = default;
    Rows(T* data, i64 rows, i64 columns) : data_(data), rows_(rows), columns_(columns) {}

    Span<T> operator[](i64 row) const {
        check_index(u64(row), u64(rows_));
        return {data_ + row * columns_, columns_};
    }
    T& operator()(i64 row, i64 column) const {
        check_index(u64(row), u64(rows_));
        check_index(u64(column), u64(columns_));
        return data_[row * columns_ + column];
    }
    i64 rows() const { return rows_; }
    i64 columns() const { return columns_; }
    T* data() const { return data_; }
    Span<T> flat() const { return {data_, rows_ * columns_}; }
    operator Rows<const T>() const { return {data_, rows_, columns_}; }

private:
    T* data_ = nullptr;
    i64 rows_ = 0, columns_ = 0;
};

// n dimensions, contiguous: the shape, and the values in its order.
template <class T, int n>
struct Array {
    Span<T> values;
    std::array<i64, n> shape;
};

}  // namespace nvsdata
