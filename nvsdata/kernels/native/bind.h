// Functions of spans and numbers as Python functions of NumPy arrays.
//
// The dtype of an array, its number of dimensions and, unless it is const, whether it is writable are checked; values
// are never converted. Input arrays that are strided or misaligned are copied. Python's lock is released while a
// function runs. Results are numbers or tuples of them: arrays that a kernel fills are allocated by its Python wrapper.
// Errors name the function, and a TypeError the argument.
//
// Functions are Python's own, not nanobind's, and arrays are taken by the buffer protocol, because calls on few events
// take no longer than nanobind's checks of the arguments. Classes, numbers and results are nanobind's.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <memory>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>

#include "span.h"

namespace nvsdata {

namespace nb = nanobind;

// An array of Python, by its buffer protocol, until the call ends.
class View {
public:
    View() { view_.obj = nullptr; }
    View(const View&) = delete;
    View& operator=(const View&) = delete;
    ~View() {
        if (view_.obj) PyBuffer_Release(&view_);
    }

    // Whether the object, always the same one, is an array.
    bool take(PyObject* object) {
        if (view_.obj) return true;
        if (PyObject_GetBuffer(object, &view_, PyBUF_FORMAT | PyBUF_STRIDES) == 0) return true;
        PyErr_Clear();
        return false;
    }

    i64 shape(int axis) const { return i64(view_.shape[axis]); }
    i64 size() const { return i64(view_.len / view_.itemsize); }
    int dimensions() const { return view_.ndim; }
    bool is_read_only() const { return view_.readonly; }

    template <class T>
    bool is_of() const {
        const char* kinds = std::is_same_v<T, bool>       ? "?"
                            : std::is_floating_point_v<T> ? "fd"
                            : std::is_signed_v<T>         ? "bhilq"
                                                          : "BHILQ";
        const char* format = view_.format ? view_.format : "B";
        // the machine's byte order; sizes are compared, because some types have several characters
        if (*format == '@' || *format == '=') ++format;
        while (*kinds && *kinds != *format) ++kinds;
        return *kinds && !format[1] && view_.itemsize == sizeof(T);
    }
    bool is_contiguous() const {
        i64 step = i64(view_.itemsize);
        for (int axis = dimensions() - 1; axis >= 0; step *= shape(axis--))
            if (view_.strides[axis] != step && shape(axis) > 1) return size() == 0;
        return true;
    }

    // The values in their order, of a strided or misaligned array's copies.
    template <class T>
    T* values() {
        bool aligned = reinterpret_cast<std::uintptr_t>(view_.buf) % alignof(T) == 0;
        if constexpr (std::is_const_v<T>)
            if (!aligned || !is_contiguous()) copy(sizeof(T));
        return static_cast<T*>(copy_ ? static_cast<void*>(copy_.get()) : view_.buf);
    }

private:
    Py_buffer view_;
    std::unique_ptr<char[]> copy_;

    // A strided array has one dimension or two.
    void copy(std::size_t item) {
        copy_.reset(new char[std::size_t(view_.len)]);
        if (is_contiguous()) {
            std::memcpy(copy_.get(), view_.buf, std::size_t(view_.len));
            return;
        }
        int last = dimensions() - 1;
        i64 columns = last ? shape(last) : 1;
        for (i64 n = 0; n < size(); ++n) {
            i64 at = n / columns * view_.strides[0] + n % columns * view_.strides[last];
            std::memcpy(copy_.get() + std::size_t(n) * item, static_cast<const char*>(view_.buf) + at, item);
        }
    }
};

// Conversion of a Python object to an argument of some type. `Found` has the data that the argument needs.
template <class T>
struct Argument {
    using Plain = std::remove_reference_t<T>;
    using Found = nb::detail::make_caster<Plain>;

    // numbers of NumPy are accepted, too
    static constexpr unsigned convert = std::is_arithmetic_v<T> ? unsigned(nb::detail::cast_flags::convert) : 0;
    static bool take(PyObject* object, View&, Found& found) {
        return object != Py_None && found.from_python(object, convert, nullptr);
    }
    static T of(View&, Found& found) { return found.operator nb::detail::cast_t<T>(); }
    static const char* name() {
        if constexpr (std::is_reference_v<T>) return nb::str(nb::type<Plain>().attr("__name__")).c_str();
        return Found::Name.text;
    }
};

// Arrays of a type: contiguous, unless they are only read and `strided`.
template <class T, int n, bool strided>
struct ArrayArgument {
    struct Found {};
    static constexpr bool is_read = std::is_const_v<T>;
    using Named = std::conditional_t<strided && is_read, nb::ndarray<T, nb::ndim<n>, nb::device::cpu>,
                                     nb::ndarray<T, nb::ndim<n>, nb::c_contig, nb::device::cpu>>;

    static bool take(PyObject* object, View& view, Found&) {
        return view.take(object) && view.dimensions() == n && view.is_of<std::remove_const_t<T>>() &&
               (is_read || !view.is_read_only()) && ((strided && is_read) || view.is_contiguous());
    }
    static const char* name() { return nb::detail::make_caster<Named>::Name.text; }
};

template <class T>
struct Argument<Span<T>> : ArrayArgument<T, 1, true> {
    static Span<T> of(View& view, typename Argument::Found&) { return {view.values<T>(), view.shape(0)}; }
};

template <class T>
struct Argument<Rows<T>> : ArrayArgument<T, 2, true> {
    static Rows<T> of(View& view, typename Argument::Found&) {
        return {view.values<T>(), view.shape(0), view.shape(1)};
    }
};

template <class T, int n>
struct Argument<Array<T, n>> : ArrayArgument<T, n, false> {
    static Array<T, n> of(View& view, typename Argument::Found&) {
        Array<T, n> array{{view.values<T>(), view.size()}, {}};
        for (int axis = 0; axis < n; ++axis) array.shape[axis] = view.shape(axis);
        return array;
    }
};

// A contiguous array of one of several types that is read.
template <class... T>
struct Argument<std::variant<Span<const T>...>> {
    struct Found {};
    static bool take(PyObject* object, View& view, Found&) {
        return view.take(object) && view.dimensions() == 1 && (view.is_of<T>() || ...) && view.is_contiguous();
    }
    static std::variant<Span<const T>...> of(View& view, Found&) {
        std::variant<Span<const T>...> spans;
        auto see = [&](auto value) {
            using Value = decltype(value);
            if (view.is_of<Value>()) spans = Span<const Value>(view.values<const Value>(), view.shape(0));
        };
        (see(T()), ...);
        return spans;
    }
    static const char* name() {
        using namespace nb::detail;
        static constexpr auto text = const_name("ndarray[dtype=") + concat(dtype_name<T>::name...) +
                                     const_name(", shape=(*), order='C', device='cpu', writable=False]");
        return text.text;
    }
};

// The position of an argument that a function doesn't accept, and the accepted type.
struct Mismatch {
    std::size_t place;
    const char* type;
};

// Functions that take the same number of arguments.
struct Overload {
    std::size_t arguments;
    // Whether one of the functions takes the arguments; the result of the first one that does, or null for an error.
    bool (*call)(const char* name, PyObject* const* given, PyObject*& result);
    Mismatch (*first_mismatch)(PyObject* const* given);
};

// Add a function to the module that calls its first overload that accepts the arguments.
void add_overload(nb::module_& module, const char* name, const Overload& overload);

// Let Python raise the exception that is being handled, with the function's name in front of the message.
void raise_in_python(const char* name) noexcept;

template <auto function>
struct Bound;

template <class R, class... A, R (*function)(A...)>
struct Bound<function> {
    static constexpr std::size_t arguments = sizeof...(A);

    static bool call(const char* name, PyObject* const* given, View* views, PyObject*& result) {
        return call(name, given, views, result, std::index_sequence_for<A...>());
    }

    static Mismatch first_mismatch(PyObject* const* given) {
        Mismatch mismatch{0, nullptr};
        [[maybe_unused]] auto takes = [&](auto argument) {
            using Taken = decltype(argument);
            View view;
            typename Taken::Found found;
            bool taken = Taken::take(given[mismatch.place], view, found);
            if (taken)
                ++mismatch.place;
            else
                mismatch.type = Taken::name();
            return taken;
        };
        (void)(takes(Argument<A>()) && ...);
        return mismatch;
    }

private:
    template <std::size_t... I>
    static bool call(const char* name, PyObject* const* given, View* views, PyObject*& result,
                     std::index_sequence<I...>) {
        std::tuple<typename Argument<A>::Found...> found;
        if (!(Argument<A>::take(given[I], views[I], std::get<I>(found)) && ...)) return false;
        auto run = [&]() -> R {
            nb::gil_scoped_release free;
            return function(Argument<A>::of(views[I], std::get<I>(found))...);
        };
        try {
            if constexpr (std::is_void_v<R>) {
                run();
                result = nb::none().release().ptr();
            } else {
                result = nb::cast(run()).release().ptr();
            }
        } catch (...) {
            raise_in_python(name);
        }
        return true;
    }
};

template <auto first, auto... others>
struct Alternatives {
    static constexpr std::size_t arguments = Bound<first>::arguments;
    static_assert(((Bound<others>::arguments == arguments) && ...));

    static bool call(const char* name, PyObject* const* given, PyObject*& result) {
        View views[arguments + 1];
        return Bound<first>::call(name, given, views, result) ||
               (Bound<others>::call(name, given, views, result) || ...);
    }
    // Fault of the function that accepts most of the arguments, which is probably the intended one.
    static Mismatch first_mismatch(PyObject* const* given) {
        Mismatch furthest{0, nullptr};
        for (Mismatch found : {Bound<first>::first_mismatch(given), Bound<others>::first_mismatch(given)...})
            if (!furthest.type || found.place > furthest.place) furthest = found;
        return furthest;
    }
};

// Define functions of one name in the module, of which the first that takes the arguments is called.
template <auto... functions>
void define(nb::module_& module, const char* name) {
    using Some = Alternatives<functions...>;
    add_overload(module, name, {Some::arguments, &Some::call, &Some::first_mismatch});
}

}  // namespace nvsdata
