// Reads from open files.
#pragma once

#ifndef _WIN32
#include <unistd.h>

#include <cerrno>
#endif

#include "span.h"

namespace nvsdata {

// Fill bytes from those of a file at byte `at` on; false if the file ends before, can't be read, or the system has no
// such call (Python reads instead where `os.pread` is missing).
inline bool read_at([[maybe_unused]] int descriptor, [[maybe_unused]] i64 at, [[maybe_unused]] Span<u8> bytes) {
#ifdef _WIN32
    return false;
#else
    i64 done = 0;
    while (done < bytes.size()) {
        auto count = pread(descriptor, bytes.data() + done, std::size_t(bytes.size() - done), off_t(at + done));
        if (count < 0 && errno == EINTR) continue;
        if (count <= 0) return false;
        done += i64(count);
    }
    return true;
#endif
}

}  // namespace nvsdata
