// Functions of spans and numbers as Python functions of NumPy arrays.
//
// An array's dtype, its number of dimensions and, unless it is const, whether it may be written are checked; values are
// never converted. Arrays that are read may be strided or misaligned: they are copied then. Python's lock is released
// while a function runs. Results are numbers or tuples of them: arrays that a kernel fills are allocated by its Python
// face.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <cstdint>
#include <cstring>
#include <memory>
#include <type_traits>
#include <utility>
#include <variant>

#include "span.h"

namespace nvsdata {

namespace nb = nanobind;

template <class T>
struct Argument {
    using Python = T;
    static T of(T value) { return value; }
};

// Arrays that are written.
template <class T>
struct Argument<Span<T>> {
    using Python = nb::ndarray<T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
    static Span<T> of(const Python& array) { return {array.data(), i64(array.shape(0))}; }
};

template <class T>
struct Argument<Rows<T>> {
    using Python = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
    static Rows<T> of(const Python& array) { return {array.data(), i64(array.shape(0)), i64(array.shape(1))}; }
};

// Of any number of dimensions: contiguous even if it is only read.
template <class T, int n>
struct Argument<Array<T, n>> {
    using Python = nb::ndarray<T, nb::ndim<n>, nb::c_contig, nb::device::cpu>;
    static Array<T, n> of(const Python& array) {
        Array<T, n> found{{array.data(), i64(array.size())}, {}};
        for (int axis = 0; axis < n; ++axis) found.shape[axis] = i64(array.shape(axis));
        return found;
    }
};

// Arrays that are read: a view or, of a strided array, a copy that lives as long as the call.
template <class T, int dimensions>
class Read {
public:
    using Python = nb::ndarray<const T, nb::ndim<dimensions>, nb::device::cpu>;

    explicit Read(const Python& array) : data_(array.data()), rows_(i64(array.shape(0))) {
        if constexpr (dimensions == 2) columns_ = i64(array.shape(1));
        bool contiguous = array.stride(dimensions - 1) == 1 || columns_ * (dimensions == 1 ? rows_ : 1) <= 1;
        if constexpr (dimensions == 2) contiguous = contiguous && (array.stride(0) == columns_ || rows_ <= 1);
        bool aligned = reinterpret_cast<std::uintptr_t>(data_) % alignof(T) == 0;
        if (contiguous && aligned) return;
        copy_.reset(new T[std::size_t(rows_ * columns_)]);
        T* out = copy_.get();
        for (i64 row = 0; row < rows_; ++row)
            for (i64 column = 0; column < columns_; ++column)
                std::memcpy(out++,
                            data_ + row * array.stride(0) + (dimensions == 2 ? column * array.stride(dimensions - 1) : 0),
                            sizeof(T));
        data_ = copy_.get();
    }
    operator Span<const T>() const { return {data_, rows_}; }
    operator Rows<const T>() const { return {data_, rows_, columns_}; }

private:
    const T* data_;
    i64 rows_, columns_ = 1;
    std::unique_ptr<T[]> copy_;
};

template <class T>
struct Argument<Span<const T>> {
    using Python = typename Read<T, 1>::Python;
    static Read<T, 1> of(const Python& array) { return Read<T, 1>(array); }
};

template <class T>
struct Argument<Rows<const T>> {
    using Python = typename Read<T, 2>::Python;
    static Read<T, 2> of(const Python& array) { return Read<T, 2>(array); }
};

// Arrays of one of several types that are read.
template <class... T>
struct Argument<std::variant<Span<const T>...>> {
    using Python = nb::ndarray<nb::ro, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
    using View = std::variant<Span<const T>...>;
    static View of(const Python& array) {
        View view;
        auto is = [&](auto type) {
            using Value = decltype(type);
            if (array.dtype() != nb::dtype<Value>()) return false;
            view = Span<const Value>(static_cast<const Value*>(array.data()), i64(array.shape(0)));
            return true;
        };
        if (!(is(T()) || ...)) throw nb::type_error("an array of another type");
        return view;
    }
};

template <auto function>
struct Bound;

template <class R, class... A, R (*function)(A...)>
struct Bound<function> {
    static R call(typename Argument<A>::Python... given) {
        nb::gil_scoped_release free;
        return function(Argument<A>::of(given)...);
    }
    // an array of another dtype is an error, not a copy; NumPy's numbers are numbers
    template <class T>
    static auto argument() {
        if constexpr (std::is_arithmetic_v<T>)
            return nb::arg();
        else
            return nb::arg().noconvert();
    }
    static void define(nb::module_& module, const char* name) { module.def(name, &call, argument<A>()...); }
};

// Define a function in the module. Of functions with one name, the first that takes the arguments is called.
template <auto function>
void define(nb::module_& module, const char* name) {
    Bound<function>::define(module, name);
}

}  // namespace nvsdata
