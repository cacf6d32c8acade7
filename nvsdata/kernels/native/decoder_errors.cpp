// A function for FFmpeg's messages: its threads call it some five times per frame, and must not wait for Python's lock.
#include <atomic>

#include "bind.h"

namespace nvsdata {

namespace {

constexpr int error_level = 16;  // FFmpeg's; those of worse errors are smaller

// FFmpeg passes nothing of the caller's to the function
std::atomic<i64> errors{0};

void count_error(void*, int level, const char*, void*) {
    if (level <= error_level) errors.fetch_add(1, std::memory_order_relaxed);
}

u64 error_counter() { return u64(reinterpret_cast<std::uintptr_t>(&count_error)); }
i64 counted_errors() { return errors.load(std::memory_order_relaxed); }

}  // namespace

void define_decoder_errors(nb::module_& module) {
    define<error_counter>(module, "error_counter");
    define<counted_errors>(module, "counted_errors");
}

}  // namespace nvsdata
