// From keys to events: sorted, unpacked, read out.
#include <cmath>
#include <stdexcept>
#include <vector>

#include "../native/bind.h"

namespace nvsdata {

namespace {

// Write keys to `out` in order of a digit; `places`: how often each value occurs, overwritten.
void distribute(Span<const u64> keys, Span<u64> out, int shift, u64 mask, std::vector<u32>& places) {
    u32 total = 0;
    for (u32& place : places) total += std::exchange(place, total);
    for (u64 key : keys) out[places[key >> shift & mask]++] = key;
}

// Sort keys stably by their times below 2^bits, in two digits; `spare` is scratch. O(N + 2^(bits / 2)).
void sort_keys(Span<u64> keys, Span<u64> spare, int bits) {
    int digit = (bits + 1) / 2, minor = 32, major = 32 + digit;
    u64 mask = (u64(1) << digit) - 1;
    std::vector<u32> minors(mask + 1), majors(mask + 1);
    for (u64 key : keys) {
        ++minors[key >> minor & mask];
        ++majors[key >> major & mask];
    }
    distribute(keys, spare, minor, mask, minors);
    distribute(spare, keys, major, mask, majors);
}

}  // namespace

void read_keys(Span<u64> keys, i64 bits, i64 start, Span<i64> t, Span<i16> x, Span<i16> y, Span<u8> p) {
    if (t.size() != keys.size() || x.size() != keys.size() || y.size() != keys.size() || p.size() != keys.size())
        throw std::invalid_argument("columns must be as long as keys");
    if (bits < 0 || bits > 32) throw std::invalid_argument("times of keys have 0 to 32 bits");
    if (keys.size() > i64(UINT32_MAX)) throw std::invalid_argument("too many keys");
    // the column of times serves as scratch until it is written
    if (bits) sort_keys(keys, {reinterpret_cast<u64*>(t.data()), t.size()}, int(bits));
    for (i64 i = 0; i < keys.size(); ++i) {
        u64 key = keys[i];
        t[i] = i64(u64(start) + (key >> 32));
        x[i] = i16(key >> 1 & 0xFFFF);
        y[i] = i16(key >> 17 & 0x7FFF);
        p[i] = u8(key & 1);
    }
}

double read_out(Span<const i64> t, Span<const i16> x, Span<const i16> y, i64 width, Span<i64> ready, i64 refractory,
                double gap, double busy, i64 start, Span<i64> out, Span<bool> kept) {
    constexpr double LATEST = 4e18;  // below 2^62
    if (x.size() != t.size() || y.size() != t.size() || out.size() != t.size() || kept.size() != t.size())
        throw std::invalid_argument("columns differ in length");
    for (i64 i = 0; i < t.size(); ++i) {
        i64 pixel = y[i] * width + x[i];
        if (x[i] < 0 || y[i] < 0 || x[i] >= width || pixel >= ready.size())
            throw std::out_of_range("an event lies outside the sensor");
        kept[i] = t[i] >= ready[pixel];
        if (!kept[i]) continue;
        double free = std::max(double(i64(u64(t[i]) - u64(start))), busy);
        busy = free + gap;
        out[i] = i64(u64(start) + u64(i64(std::min(std::ceil(free), LATEST))));
        ready[pixel] = i64(u64(std::max(out[i], t[i])) + u64(refractory));
    }
    return busy;
}

void define_spikes(nb::module_& module) {
    define<read_keys>(module, "read_keys");
    define<read_out>(module, "read_out");
}

}  // namespace nvsdata
