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

// An array of Python, by its buffer protocol, until the call ends.
class View {
public:
    View() = default;
    View(const View&) = delete;
    View& operator=(const View&) = delete;
    ~View() { PyBuffer_Release(&view_); }

    i64 shape(int axis) const { return i64(view_.shape[axis]); }
    i64 stride(int axis) const { return i64(view_.strides[axis]); }  // bytes
    i64 size() const { return i64(view_.len / view_.itemsize); }
    void* data() const { return view_.buf; }

    template <class T>
    bool is_of() const {
        const char* kinds = std::is_same_v<T, bool>       ? "?"
                            : std::is_floating_point_v<T> ? "fd"
                            : std::is_signed_v<T>         ? "bhilq"
                                                          : "BHILQ";
        const char* format = view_.format;
        // the machine's byte order; sizes are compared, because some types have several characters
        if (*format == '@' || *format == '=') ++format;
        return *format && !format[1] && std::strchr(kinds, *format) && view_.itemsize == sizeof(T);
    }

protected:
    bool get(PyObject* object, int dimensions, int flags) noexcept {
        if (PyObject_GetBuffer(object, &view_, PyBUF_FORMAT | flags) == 0) return view_.ndim == dimensions;
        PyErr_Clear();
        return false;
    }

private:
    Py_buffer view_{};
};

// An array of T; if T is const, it is only read, and may be strided or misaligned unless `contiguous`.
template <class T, int dimensions, bool contiguous = !std::is_const_v<T>>
class Buffer : public View {
public:
    using Value = std::remove_const_t<T>;
    // how errors name it
    using Named =
        std::conditional_t<contiguous, nb::ndarray<T, nb::ndim<dimensions>, nb::c_contig, nb::device::cpu>,
                           nb::ndarray<T, nb::ndim<dimensions>, nb::device::cpu>>;
    static constexpr auto Name = nb::detail::make_caster<Named>::Name;

    bool take(PyObject* object) noexcept {
        constexpr int access = std::is_const_v<T> ? 0 : PyBUF_WRITABLE;
        return get(object, dimensions, access | (contiguous ? PyBUF_C_CONTIGUOUS : PyBUF_STRIDES)) && is_of<Value>();
    }
    T* values() {
        if constexpr (!contiguous)
            if (!is_dense()) return copied();
        return static_cast<T*>(data());
    }

private:
    std::unique_ptr<Value[]> copy_;

    bool is_dense() const {
        bool dense = reinterpret_cast<std::uintptr_t>(data()) % alignof(T) == 0;
        i64 step = sizeof(T);
        for (int axis = dimensions - 1; axis >= 0; step *= shape(axis--))
            dense = dense && (stride(axis) == step || shape(axis) <= 1);
        return dense || size() == 0;
    }

    T* copied() {
        static_assert(dimensions <= 2);
        copy_.reset(new Value[std::size_t(size())]);
        i64 columns = dimensions == 2 ? shape(dimensions - 1) : 1;
        for (i64 n = 0; n < size(); ++n) {
            i64 at = n / columns * stride(0) + n % columns * stride(dimensions - 1);
            std::memcpy(&copy_[std::size_t(n)], static_cast<const char*>(data()) + at, sizeof(T));
        }
        return copy_.get();
    }
};

// A contiguous array of one of several types that is read.
template <class... T>
class OneOf : public View {
public:
    static constexpr auto Name = nb::detail::const_name("ndarray[dtype=") +
                                 nb::detail::concat(nb::detail::dtype_name<T>::name...) +
                                 nb::detail::const_name(", shape=(*), order='C', device='cpu', writable=False]");

    bool take(PyObject* object) noexcept { return get(object, 1, PyBUF_C_CONTIGUOUS) && (is_of<T>() || ...); }
};

template <class T>
struct Argument {
    using Python = T;
    static T of(T value) { return value; }
};

template <class T>
struct Argument<Span<T>> {
    using Python = Buffer<T, 1>&;
    static Span<T> of(Python array) { return {array.values(), array.shape(0)}; }
};

template <class T>
struct Argument<Rows<T>> {
    using Python = Buffer<T, 2>&;
    static Rows<T> of(Python array) { return {array.values(), array.shape(0), array.shape(1)}; }
};

// Of any number of dimensions: contiguous even if it is only read.
template <class T, int n>
struct Argument<Array<T, n>> {
    using Python = Buffer<T, n, true>&;
    static Array<T, n> of(Python array) {
        Array<T, n> found{{array.values(), array.size()}, {}};
        for (int axis = 0; axis < n; ++axis) found.shape[axis] = array.shape(axis);
        return found;
    }
};

template <class... T>
struct Argument<std::variant<Span<const T>...>> {
    using Python = OneOf<T...>&;
    using Spans = std::variant<Span<const T>...>;
    static Spans of(Python array) {
        Spans found;
        auto see = [&](auto value) {
            using Value = decltype(value);
            if (array.template is_of<Value>())
                found = Span<const Value>(static_cast<const Value*>(array.data()), array.shape(0));
        };
        (see(T()), ...);
        return found;
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
        using Plain = std::remove_reference_t<typename Argument<T>::Python>;
        bool fits;
        if constexpr (std::is_base_of_v<View, Plain>) {
            fits = Plain().take(object.ptr());
        } else {
            std::conditional_t<std::is_reference_v<T>, Plain*, Plain> value{};
            fits = !object.is_none() && nb::try_cast(object, value, std::is_arithmetic_v<T>);
        }
        if (fits) {
            ++found.place;
            return true;
        }
        if constexpr (std::is_reference_v<T>)
            found.type = nb::str(nb::type<Plain>().attr("__name__")).c_str();
        else
            found.type = nb::detail::make_caster<Plain>::Name.text;
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

namespace nanobind::detail {

template <class Array>
struct ArrayCaster {
    NB_TYPE_CASTER(Array, Array::Name)

    template <class Flags>
    bool from_python(handle source, Flags, cleanup_list*) noexcept {
        return value.take(source.ptr());
    }
};

template <class T, int dimensions, bool contiguous>
struct type_caster<nvsdata::Buffer<T, dimensions, contiguous>> : ArrayCaster<nvsdata::Buffer<T, dimensions, contiguous>> {};

template <class... T>
struct type_caster<nvsdata::OneOf<T...>> : ArrayCaster<nvsdata::OneOf<T...>> {};

}  // namespace nanobind::detail

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
