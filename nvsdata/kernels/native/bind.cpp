// Functions of Python, and their errors.
#include "bind.h"

#include <map>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

namespace nvsdata {

namespace {

struct Function {
    std::string name;
    std::vector<Overload> overloads;
    PyMethodDef definition{};
};

std::string text_of(const nb::object& object) { return nb::str(nb::handle(object)).c_str(); }

// An argument as it is shown in an error.
std::string shown(nb::handle object) {
    std::string text = text_of(object.type().attr("__name__"));
    if (!nb::hasattr(object, "flags") || !nb::hasattr(object, "dtype")) return text;
    text += " of " + text_of(object.attr("dtype")) + ", shape " + text_of(object.attr("shape"));
    nb::object flags = object.attr("flags");
    if (!nb::cast<bool>(flags.attr("c_contiguous"))) text += ", not contiguous";
    if (!nb::cast<bool>(flags.attr("writeable"))) text += ", read-only";
    return text;
}

// The error for arguments that none of the functions accepts.
std::string refusal(const Function& function, PyObject* const* given, std::size_t count) {
    Mismatch furthest{0, nullptr};
    for (const Overload& overload : function.overloads) {
        if (overload.arguments != count) continue;
        Mismatch found = overload.first_mismatch(given);
        if (!furthest.type || found.place > furthest.place) furthest = found;
    }
    if (!furthest.type)
        return function.name + "(): takes " + std::to_string(function.overloads[0].arguments) + " arguments, not " +
               std::to_string(count);
    return function.name + "(): argument " + std::to_string(furthest.place + 1) + " must be " + furthest.type +
           ", not " + shown(given[furthest.place]);
}

PyObject* call(PyObject* self, PyObject* const* given, Py_ssize_t count) noexcept {
    const auto& function = *static_cast<const Function*>(PyCapsule_GetPointer(self, nullptr));
    try {
        PyObject* result = nullptr;
        for (const Overload& overload : function.overloads)
            if (overload.arguments == std::size_t(count) && overload.call(function.name.c_str(), given, result))
                return result;
        PyErr_SetString(PyExc_TypeError, refusal(function, given, std::size_t(count)).c_str());
    } catch (...) {
        raise_in_python(function.name.c_str());
    }
    return nullptr;
}

}  // namespace

void add_overload(nb::module_& module, const char* name, const Overload& overload) {
    // never destroyed, because functions may be called until Python ends
    static auto& functions = *new std::map<std::string, Function>;
    Function& function = functions[name];
    function.overloads.push_back(overload);
    if (!function.name.empty()) return;
    function.name = name;
    auto pointer = reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(&call));
    function.definition = {function.name.c_str(), pointer, METH_FASTCALL, nullptr};
    nb::capsule self(&function);
    PyObject* made = PyCFunction_NewEx(&function.definition, self.ptr(), nb::str(module.attr("__name__")).ptr());
    if (!made) throw nb::python_error();
    module.attr(name) = nb::steal(made);
}

void raise_in_python(const char* name) noexcept {
    auto raise = [name](PyObject* type, const char* message) {
        PyErr_Format(type, "%s(): %s", name, message);
    };
    try {
        throw;
    } catch (nb::python_error& error) {
        error.restore();
    } catch (const std::out_of_range& error) {
        raise(PyExc_IndexError, error.what());
    } catch (const std::logic_error& error) {
        // std::invalid_argument, and std::length_error of a vector
        raise(PyExc_ValueError, error.what());
    } catch (const std::bad_alloc&) {
        PyErr_NoMemory();
    } catch (const std::exception& error) {
        raise(PyExc_RuntimeError, error.what());
    }
}

}  // namespace nvsdata
