// Whether events are on their sensor, and their places in images.
#include "../native/bind.h"
#include "../native/levels.h"
#include "events.h"

namespace nvsdata {

namespace {

// The highest bit of at least one of both numbers is 1 for a value outside of 0 .. last.
u16 sign_of(i16 value, i16 last) { return u16(value | (last - value)); }

i16 last_of(i64 size) { return i16(std::clamp<i64>(size, 0, 32768) - 1); }

NVSDATA_INLINE bool are_within(const i16* values, i64 count, i16 last) {
    u16 signs = 0;
    for (i64 i = 0; i < count; ++i) signs |= sign_of(values[i], last);
    return signs >> 15 == 0;
}

NVSDATA_INLINE bool are_bits(const u8* values, i64 count) {
    u8 all = 0;
    for (i64 i = 0; i < count; ++i) all |= values[i];
    return all < 2;
}

// If events have polarities, those of polarity `second` are in the second image.
template <bool has_polarity>
NVSDATA_INLINE bool place_pixels(const i16* x, const i16* y, const u8* p, i64 count, i16 right, i16 bottom, u32 stride,
                                 u8 second, u32 size, u32* places) {
    u16 signs = 0;
    u8 bits = 0;
    for (i64 i = 0; i < count; ++i) {
        signs |= sign_of(x[i], right) | sign_of(y[i], bottom);
        u32 place = u32(u16(y[i])) * stride + u16(x[i]);
        if constexpr (has_polarity) {
            bits |= p[i];
            place += p[i] == second ? size : 0;
        }
        places[i] = place;
    }
    return signs >> 15 == 0 && bits < 2;
}

bool inside(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 width, i64 height) {
    i64 n = t.size();
    return x.size() == n && y.size() == n && p.size() == n && are_inside({width, height}, {x, y, p});
}

}  // namespace

NVSDATA_INLINE bool scale_times_loop(const i64* t, i64 count, i64 first, u64 most, double scale, double span,
                                     double* out) {
    u64 longest = 0;
    for (i64 k = 0; k < count; ++k) {
        i64 since = minus(t[k], first);
        longest = std::max(longest, u64(since));
        out[k] = double(since) * scale / span;
    }
    return longest <= most;
}

bool scale_times(const i64* t, i64 count, i64 first, u64 most, double scale, double span, double* out) {
    return best<scale_times_loop>(t, count, first, most, scale, span, out);
}

bool are_inside(const Images& images, const Pixels& events) {
    return best<are_within>(events.x.data(), events.x.size(), last_of(images.width)) &&
           best<are_within>(events.y.data(), events.y.size(), last_of(images.height)) &&
           best<are_bits>(events.p.data(), events.p.size());
}

bool place(const Images& images, const Pixels& events, i64 from, i64 to, u32* places) {
    require(images.size <= i64(1) << 31, "images are too large");
    const i16 *x = events.x.part(from, to).data(), *y = events.y.part(from, to).data();
    i64 count = to - from;
    i16 right = last_of(images.width), bottom = last_of(images.height);
    u32 stride = u32(images.stride), size = events.image == Polarity::same_image ? 0 : u32(images.size);
    u8 second = events.image == Polarity::off_first;
    if (!events.p.data())
        return best<place_pixels<false>>(x, y, static_cast<const u8*>(nullptr), count, right, bottom, stride, second,
                                         size, places);
    const u8* p = events.p.part(from, to).data();
    return best<place_pixels<true>>(x, y, p, count, right, bottom, stride, second, size, places);
}

void define_inside(nb::module_& module) { define<inside>(module, "inside"); }

}  // namespace nvsdata
