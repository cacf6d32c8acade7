// Errors of bound functions.
#include "bind.h"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace nvsdata {

namespace {

// Never destroyed, because functions may be called until Python ends.
std::map<std::string, std::vector<Overload>>& overloads() {
    static auto& all = *new std::map<std::string, std::vector<Overload>>;
    return all;
}

std::string text_of(const nb::object& object) { return nb::str(nb::handle(object)).c_str(); }

// An argument as an error shows it.
std::string shown(nb::handle object) {
    std::string text = text_of(object.type().attr("__name__"));
    if (!nb::hasattr(object, "flags") || !nb::hasattr(object, "dtype")) return text;
    text += " of " + text_of(object.attr("dtype")) + ", shape " + text_of(object.attr("shape"));
    nb::object flags = object.attr("flags");
    if (!nb::cast<bool>(flags.attr("c_contiguous"))) text += ", not contiguous";
    if (!nb::cast<bool>(flags.attr("writeable"))) text += ", read-only";
    return text;
}

}  // namespace

void note_overload(const char* name, const Overload& overload) { overloads()[name].push_back(overload); }

void refuse(const char* name, const nb::handle* given, std::size_t count) {
    Mismatch furthest{0, nullptr};
    for (const Overload& overload : overloads()[name]) {
        if (overload.arguments != count) continue;
        // the function that most of the arguments fit is likely to be meant
        Mismatch found = overload.first_mismatch(given);
        if (!furthest.type || found.place > furthest.place) furthest = found;
    }
    std::string text = std::string(name) + "(): argument " + std::to_string(furthest.place + 1) + " must be " +
                       furthest.type + ", not " + shown(given[furthest.place]);
    throw nb::type_error(text.c_str());
}

void raise_with(const char* name) {
    std::string before = std::string(name) + "(): ";
    try {
        throw;
    } catch (const std::out_of_range& error) {
        throw std::out_of_range(before + error.what());
    } catch (const std::invalid_argument& error) {
        throw std::invalid_argument(before + error.what());
    } catch (const nb::builtin_exception& error) {
        throw nb::builtin_exception(error.type(), (before + error.what()).c_str());
    }
}

void define_refusals(nb::module_& module) {
    for (auto& [name, functions] : overloads()) {
        std::vector<std::size_t> defined;
        for (const Overload& overload : functions) {
            if (std::count(defined.begin(), defined.end(), overload.arguments)) continue;
            defined.push_back(overload.arguments);
            if (overload.arguments) overload.define_refusal(module, name.c_str());
        }
    }
}

}  // namespace nvsdata
