// Exponentials that grow with time, so that the value at a later time is a product instead of an exponential.
//
// A value is kept as exp((t - begin) / tau), where `begin` is that of the event's epoch. An epoch lasts EPOCH tau, in
// whole µs; values older than the previous epoch count as 0.
#pragma once

#include <cmath>

#include "../native/times.h"
#include "events.h"

namespace nvsdata {

constexpr double EPOCH = 300;  // exp(300) fits double, and so does its product with exp(-300)

struct Epochs {
    double tau;
    i64 length;  // integers, so that times within an epoch are exact at any time
    double old;  // factor by which a value decays in an epoch

    explicit Epochs(double tau) : tau(tau) {
        require(tau > 0, "tau must be positive");
        length = i64(std::min(std::ceil(EPOCH * tau), double(LATEST)));
        old = std::exp(double(-length) / tau);
    }
    // The epoch of a time since the first event.
    i64 of(i64 since) const { return floor_divide(since, length); }
    double value(i64 since, i64 epoch) const { return std::exp(double(minus(since, times(epoch, length))) / tau); }
    double faded(i64 epochs) const { return epochs == 0 ? 1.0 : epochs == 1 ? old : 0.0; }
};

}  // namespace nvsdata
