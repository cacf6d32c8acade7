// Reads from open files, without moving their position: a system call from Python costs more than the reading.
#pragma once

#ifndef _WIN32
#include <cerrno>
#include <unistd.h>
#endif

#include "../native/span.h"

namespace nvsdata {

// Fill `out` with a file's bytes from `begin` on. Returns false if there are fewer, and always where systems can't.
template <class T>
bool read_at([[maybe_unused]] int handle, [[maybe_unused]] i64 begin, [[maybe_unused]] Span<T> out) {
#ifdef _WIN32
    return false;
#else
    char* to = reinterpret_cast<char*>(out.data());
    std::size_t left = std::size_t(out.size()) * sizeof(T);
    while (left) {
        ssize_t got = ::pread(handle, to, left, begin);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return false;
        to += got, left -= std::size_t(got), begin += got;
    }
    return true;
#endif
}

}  // namespace nvsdata
