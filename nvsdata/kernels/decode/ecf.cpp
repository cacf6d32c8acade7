// ECF, Prophesee's compression of HDF5 chunks of events. A chunk has the number of events and the coding of its positions
// in 4 bytes, the first time in 8, and then all times, all y, all x and all polarities.
#include <algorithm>
#include <cstring>
#include <vector>

#include "../native/bind.h"

namespace nvsdata {

namespace {

constexpr i64 MOST = 65535;  // events of a chunk
constexpr i64 DAMAGED = -1;

// Numbers in the machine's byte order, one after the other; 0 behind the end, which `ran_out` remembers.
class Source {
public:
    explicit Source(Span<const u8> data) : data_(data) {}

    template <class T>
    T next() {
        T value = 0;
        if (left() < i64(sizeof(T))) {
            ran_out_ = true;
            return value;
        }
        std::memcpy(&value, data_.begin() + at_, sizeof(T));
        at_ += i64(sizeof(T));
        return value;
    }

    i64 left() const { return data_.size() - at_; }
    bool ran_out() const { return ran_out_; }

private:
    Span<const u8> data_;
    i64 at_ = 0;
    bool ran_out_ = false;
};

constexpr i64 SPARE = 16;  // values behind the last event, so that short runs are written without loops

struct Events {
    explicit Events(i64 count) : count(count), t(size()), y(size()), x(size()), p(size()) {}

    size_t size() const { return size_t(count + SPARE); }

    i64 count;
    std::vector<u64> t;
    std::vector<u16> y, x;
    std::vector<u8> p;
};

// Write a value for the next `length` events, and return whether there are as many.
template <i64 SHORT, class T>
bool run(std::vector<T>& values, i64& done, i64 length, i64 count, T value) {
    static_assert(SHORT <= SPARE);
    if (length < 1 || length > count - done) return false;
    T* out = values.data() + done;
    // most runs are short, and a loop of known length costs less than a wrong guess of its end
    std::fill_n(out, SHORT, value);
    if (length > SHORT) std::fill_n(out + SHORT, length - SHORT, value);
    done += length;
    return true;
}

// A byte has the difference to the time before (0 to 14 µs) and the number of events at that time (15: in the next two
// bytes). For a larger difference, bytes of 15 and four of its bits each come first, the lowest bits first.
bool read_times(Source& source, Events& events) {
    u64 t = source.next<u64>();
    for (i64 done = 0; done < events.count;) {
        u64 far = 0;
        u8 code = source.next<u8>();
        for (int shift = 0; code >> 4 == 15; shift += 4, code = source.next<u8>()) {
            if (shift >= 64) return false;
            far |= u64(code & 15) << shift;
        }
        t += far + (code >> 4);
        i64 length = code & 15;
        if (length == 15) length = source.next<u16>();
        if (!run<4>(events.t, done, length, events.count, t)) return false;
    }
    return true;
}

// 11 bits of y, and 5 of the number of events there (31: in the next two bytes).
bool read_y(Source& source, Events& events) {
    for (i64 done = 0; done < events.count;) {
        u16 code = source.next<u16>();
        i64 length = code & 31;
        if (length == 31) length = source.next<u16>();
        if (!run<8>(events.y, done, length, events.count, u16(code >> 5))) return false;
    }
    return true;
}

// 11 bits of x, and a bit for each of the five columns to the right, where there is an event, too.
void read_x(Source& source, Events& events) {
    u16* out = events.x.data();
    // beyond the last event, the bits have no meaning: they are written to the spare values
    for (u16* end = out + events.count; out < end && !source.ran_out();) {
        u16 code = source.next<u16>(), x = code >> 5;
        *out++ = x;
        for (int right = 1; right <= 5; ++right) {
            *out = u16(x + right);
            out += code >> (5 - right) & 1;
        }
    }
}

// A bit of polarity, and 7 of the number of events with it (127: in the next two bytes).
bool read_polarities(Source& source, Events& events) {
    for (i64 done = 0; done < events.count;) {
        u8 code = source.next<u8>();
        i64 length = code & 127;
        if (length == 127) length = source.next<u16>();
        if (!run<16>(events.p, done, length, events.count, u8(code >> 7))) return false;
    }
    return true;
}

// Four events in three words: x and polarity in 12 bits each.
void read_x_and_polarities(Source& source, Events& events) {
    for (size_t i = 0; i < size_t(events.count) && !source.ran_out(); i += 4) {
        u32 a = source.next<u16>(), b = source.next<u16>(), c = source.next<u16>();
        u32 four[] = {a >> 4, (a & 15) | b >> 8 << 4, (b & 255) | c >> 12 << 8, c & 4095};
        for (size_t k = 0; k < 4; ++k) {
            events.x[i + k] = u16(four[k] >> 1);
            events.p[i + k] = four[k] & 1;
        }
    }
}

// Four events in three words: y, x and polarity in 24 bits each.
void read_positions(Source& source, Events& events) {
    for (size_t i = 0; i < size_t(events.count) && !source.ran_out(); i += 4) {
        u32 a = source.next<u32>(), b = source.next<u32>(), c = source.next<u32>();
        u32 four[] = {a >> 8, (a & 255) | b >> 16 << 8, (b & 65535) | c >> 24 << 16, c & 16777215};
        for (size_t k = 0; k < 4; ++k) {
            events.y[i + k] = four[k] >> 12 & 2047;
            events.x[i + k] = four[k] >> 1 & 2047;
            events.p[i + k] = four[k] & 1;
        }
    }
}

bool read_all(Source& source, Events& events, bool positions_together, bool x_with_polarity) {
    if (!read_times(source, events)) return false;
    if (positions_together) {
        read_positions(source, events);
        return true;
    }
    if (!read_y(source, events)) return false;
    if (x_with_polarity) {
        read_x_and_polarities(source, events);
        return true;
    }
    read_x(source, events);
    return read_polarities(source, events);
}

// Return the number of events, also if `words`, two for each of them, are too few; -1 if the data is damaged.
i64 expand_ecf(Span<const u8> data, Span<u64> words) {
    Source source(data);
    u32 head = source.next<u32>();
    i64 count = head >> 2;
    if (count > MOST) return DAMAGED;
    if (2 * count > words.size()) return count;
    Events events(count);
    if (!read_all(source, events, head & 2, head & 1) || source.ran_out() || source.left()) return DAMAGED;
    for (size_t i = 0; i < size_t(count); ++i) {
        // as in HDF5: 16 bits each of x, y and polarity in one word, and the time in another
        words[i64(2 * i)] = events.x[i] | u64(events.y[i]) << 16 | u64(events.p[i]) << 32;
        words[i64(2 * i) + 1] = events.t[i];
    }
    return count;
}

}  // namespace

void define_ecf(nb::module_& module) { define<expand_ecf>(module, "expand_ecf"); }

}  // namespace nvsdata
