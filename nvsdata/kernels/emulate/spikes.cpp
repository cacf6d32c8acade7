// From keys to events: sorting, unpacking, readout.
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "../native/bind.h"
#include "../native/interrupt.h"
#include "../native/levels.h"
#include "../native/require.h"
#include "../native/times.h"

namespace nvsdata {

namespace {

constexpr i64 OFTEN = 1 << 16;  // keys between two polls for Ctrl-C

// A digit of keys, and the place of the next key for each value of the digit.
struct Digit {
    u64 shift, mask;
    Span<u32> places;

    u32& place_of(u64 key) const { return places[i64(key >> shift & mask)]; }
};

NVSDATA_INLINE void distribute(Span<const u64> keys, Digit digit, Span<u64> out, Interrupt* interrupt) {
    for (i64 start = 0; start < keys.size(); start += OFTEN) {
        interrupt->poll();
        for (i64 i = start, stop = std::min(start + OFTEN, keys.size()); i < stop; ++i)
            out[digit.place_of(keys[i])++] = keys[i];
    }
}

// Sort keys stably by two digits, whose places are 0; `spare` is scratch. O(N + values of a digit).
NVSDATA_INLINE void sort_by(Digit minor, Digit major, Span<u64> keys, Span<u64> spare, Interrupt* interrupt) {
    for (i64 i = 0; i < keys.size(); ++i) {
        ++minor.place_of(keys[i]);
        ++major.place_of(keys[i]);
    }
    u32 before = 0, before_major = 0;
    for (i64 value = 0; value < minor.places.size(); ++value) {
        before += std::exchange(minor.places[value], before);
        before_major += std::exchange(major.places[value], before_major);
    }
    distribute(keys, minor, spare, interrupt);
    distribute(spare, major, keys, interrupt);
}

void sort_keys(Span<u64> keys, Span<u64> spare, i64 bits) {
    Interrupt interrupt;
    u64 digit = u64(bits + 1) / 2, values = u64(1) << digit;
    std::vector<u32> places(2 * values);
    Span<u32> all(places);
    Digit minor{32, values - 1, all.part(0, i64(values))};
    Digit major{32 + digit, values - 1, all.part(i64(values), all.size())};
    best<sort_by>(minor, major, keys, spare, &interrupt);
}

NVSDATA_INLINE void unpack(Span<const u64> keys, i64 start, Span<i64> t, Span<i16> x, Span<i16> y, Span<u8> p) {
    for (i64 i = 0; i < keys.size(); ++i) {
        u64 key = keys[i];
        t[i] = i64(u64(start) + (key >> 32));
        x[i] = i16(u32(key) >> 1 & 0xFFFF);
        y[i] = i16(u32(key) >> 17);
        p[i] = u8(key & 1);
    }
}

// Events of a sensor with a slow readout and refractory pixels.
struct Readout {
    Span<const i64> t;
    Span<const i16> x, y;
    i64 width;
    Span<i64> ready;
    i64 refractory;
    double gap, busy;
    i64 start;
    Span<i64> out;
    Span<bool> kept;
};

NVSDATA_INLINE void pass_on(Readout* readout) {
    auto [t, x, y, width, ready, refractory, gap, busy, start, out, kept] = *readout;
    for (i64 i = 0; i < t.size(); ++i) {
        u64 pixel = u64(i64(y[i])) * u64(width) + u64(i64(x[i]));
        if (pixel >= u64(ready.size())) throw std::out_of_range("an event lies outside the sensor");
        i64 time = t[i];
        bool seen = time >= ready[i64(pixel)];
        kept[i] = seen;
        if (!seen) continue;
        double free = std::max(double(i64(u64(time) - u64(start))), busy);
        if (!(free < double(LATEST))) throw std::out_of_range("the readout falls too far behind");
        busy = free + gap;
        i64 leaves = i64(u64(start) + u64(i64(std::ceil(free))));
        out[i] = leaves;
        ready[i64(pixel)] = i64(u64(std::max(leaves, time)) + u64(refractory));
    }
    readout->busy = busy;
}

}  // namespace

void read_keys(Span<u64> keys, i64 bits, i64 start, Span<i64> t, Span<i16> x, Span<i16> y, Span<u8> p) {
    i64 n = keys.size();
    require(t.size() == n && x.size() == n && y.size() == n && p.size() == n, "columns must be as long as keys");
    require(bits >= 0 && bits <= 32, "times of keys have 0 to 32 bits");
    require(n <= i64(UINT32_MAX), "too many keys");
    // the column of times is scratch memory until it is written
    if (bits) sort_keys(keys, {reinterpret_cast<u64*>(t.data()), t.size()}, bits);
    best<unpack>(keys, start, t, x, y, p);
}

double read_out(Span<const i64> t, Span<const i16> x, Span<const i16> y, i64 width, Span<i64> ready, i64 refractory,
                double gap, double busy, i64 start, Span<i64> out, Span<bool> kept) {
    i64 n = t.size();
    require(x.size() == n && y.size() == n && out.size() == n && kept.size() == n, "columns differ in length");
    Readout readout{t, x, y, width, ready, refractory, gap, busy, start, out, kept};
    best<pass_on>(&readout);
    return readout.busy;
}

void define_spikes(nb::module_& module) {
    define<read_keys>(module, "read_keys");
    define<read_out>(module, "read_out");
}

}  // namespace nvsdata
