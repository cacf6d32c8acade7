// Ctrl-C in long loops, which run without Python's lock.
#pragma once

#include <chrono>

#include <nanobind/nanobind.h>

#include "span.h"

namespace nvsdata {

// Asks Python for signals, at most ten times a second. `poll` is for loops of thousands of steps each; it throws what
// the signal's handler raised.
class Interrupt {
public:
    void poll() {
        auto now = Clock::now();
        bool due = now >= next_ && is_started_;
        if (due || !is_started_) next_ = now + pause;
        is_started_ = true;
        if (!due) return;
        nanobind::gil_scoped_acquire lock;
        if (PyErr_CheckSignals() != 0) throw nanobind::python_error();
    }

private:
    using Clock = std::chrono::steady_clock;
    static constexpr std::chrono::milliseconds pause{100};
    Clock::time_point next_;
    bool is_started_ = false;  // set by the first poll, so that short calls don't read the clock
};

}  // namespace nvsdata
