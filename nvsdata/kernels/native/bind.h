// Functions of spans and numbers as Python functions of NumPy arrays.
//
// An array's dtype, its number of dimensions and, unless it is const, whether it may be written are checked; values are
// never converted. Arrays that are read may be strided or misaligned: they are copied then. Python's lock is released
// while a function runs. Results are numbers or tuples of them: arrays that a kernel fills are allocated by its Python
// face. Errors name the function, and a TypeError the argument.
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
        i64 across = dimensions == 2 ? array.stride(dimensions - 1) : 0;
        for (i64 row = 0; row < rows_; ++row)
            for (i64 column = 0; column < columns_; ++column)
                std::memcpy(out++, data_ + row * array.stride(0) + column * across, sizeof(T));
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

// An array of one of several types that is read.
template <class... T>
struct OneOf {
    using Array = nb::ndarray<nb::ro, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
    Array array;
};

template <class... T>
struct Argument<std::variant<Span<const T>...>> {
    using Python = OneOf<T...>;
    using View = std::variant<Span<const T>...>;
    static View of(const Python& given) {
        View view;
        auto see = [&](auto type) {
            using Value = decltype(type);
            const auto& array = given.array;
            if (array.dtype() == nb::dtype<Value>())
                view = Span<const Value>(static_cast<const Value*>(array.data()), i64(array.shape(0)));
        };
        (see(T()), ...);
        return view;
    }
};

// The place of an argument that a function doesn't take, and what it takes there.
struct Mismatch {
    std::size_t place;
    const char* type;
};

// Any argument, after all functions of a name have refused it, even converted.
struct Refused {
    nb::handle object;
};

// What errors need to know about a function that is bound.
struct Overload {
    std::size_t arguments;
    Mismatch (*first_mismatch)(const nb::handle* given);
    void (*define_refusal)(nb::module_& module, const char* name);
};

// Keep what errors need to know about a function.
void note_overload(const char* name, const Overload& overload);

// Raise the TypeError of arguments that no function of a name takes.
[[noreturn]] void refuse(const char* name, const nb::handle* given, std::size_t count);

// Raise the exception that is being handled, with the function's name in front of the message.
[[noreturn]] void raise_with(const char* name);

// An array of another dtype is an error, not a copy; NumPy's numbers are numbers.
template <class T>
auto argument() {
    if constexpr (std::is_arithmetic_v<T>)
        return nb::arg();
    else
        return nb::arg().noconvert();
}

template <auto function>
struct Bound;

template <class R, class... A, R (*function)(A...)>
struct Bound<function> {
    static void define(nb::module_& module, const char* name) {
        auto call = [name](typename Argument<A>::Python... given) -> R {
            nb::gil_scoped_release free;
            try {
                return function(Argument<A>::of(given)...);
            } catch (...) {
                raise_with(name);
            }
        };
        module.def(name, call, argument<A>()...);
        note_overload(name, {sizeof...(A), &first_mismatch, &define_refusal});
    }

private:
    template <class>
    using RefusedOf = Refused;
    template <class>
    static auto any() {
        return nb::arg().none();
    }

    static void define_refusal(nb::module_& module, const char* name) {
        auto call = [name](RefusedOf<A>... given) {
            const nb::handle objects[] = {given.object..., nb::handle()};
            refuse(name, objects, sizeof...(A));
        };
        module.def(name, call, any<A>()...);
    }

    static Mismatch first_mismatch(const nb::handle* given) {
        Mismatch found{0, nullptr};
        (void)(takes<A>(given[found.place], found) && ...);
        return found;
    }

    template <class T>
    static bool takes(nb::handle object, Mismatch& found) {
        using Python = typename Argument<T>::Python;
        std::conditional_t<std::is_reference_v<T>, std::remove_reference_t<T>*, Python> value{};
        if (!object.is_none() && nb::try_cast(object, value, std::is_arithmetic_v<T>)) {
            ++found.place;
            return true;
        }
        if constexpr (std::is_reference_v<T>)
            found.type = nb::str(nb::type<std::remove_reference_t<T>>().attr("__name__")).c_str();
        else
            found.type = nb::detail::make_caster<Python>::Name.text;
        return false;
    }
};

// Define a function in the module. Of functions with one name, the first that takes the arguments is called.
template <auto function>
void define(nb::module_& module, const char* name) {
    Bound<function>::define(module, name);
}

// Define, after all functions, what names the arguments that none of them takes.
void define_refusals(nb::module_& module);

}  // namespace nvsdata

template <class... T>
struct nanobind::detail::type_caster<nvsdata::OneOf<T...>> {
    using Array = typename nvsdata::OneOf<T...>::Array;
    NB_TYPE_CASTER(nvsdata::OneOf<T...>,
                   const_name("ndarray[dtype=") + concat(dtype_name<T>::name...) +
                       const_name(", shape=(*), order='C', device='cpu', writable=False]"))

    template <class Flags>
    bool from_python(handle source, Flags flags, cleanup_list* cleanup) noexcept {
        make_caster<Array> caster;
        if (!caster.from_python(source, flags, cleanup)) return false;
        value.array = std::move(caster.value);
        return ((value.array.dtype() == nanobind::dtype<T>()) || ...);
    }
};

// Refuses what isn't converted, so that other functions are tried with conversions first.
template <>
struct nanobind::detail::type_caster<nvsdata::Refused> {
    NB_TYPE_CASTER(nvsdata::Refused, const_name("object"))

    template <class Flags>
    bool from_python(handle source, Flags flags, cleanup_list*) noexcept {
        value.object = source;
        return flags & Flags(cast_flags::convert);
    }
};
