// Whether events lie on their sensor, and where in images.
#include "../native/bind.h"
#include "../native/levels.h"
#include "events.h"

namespace nvsdata {

namespace {

// The highest bit of one of both numbers is 1 for a value outside of 0 .. last.
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

NVSDATA_INLINE bool place_pixels(const i16* x, const i16* y, i64 count, i16 right, i16 bottom, u32 stride,
                                      i64* places) {
    u16 signs = 0;
    for (i64 i = 0; i < count; ++i) {
        signs |= sign_of(x[i], right) | sign_of(y[i], bottom);
        places[i] = i64(u64(u16(y[i])) * stride + u16(x[i]));
    }
    return signs >> 15 == 0;
}

NVSDATA_INLINE void choose_images(const u8* p, i64 count, u8 first, i64 size, i64* places) {
    for (i64 i = 0; i < count; ++i) places[i] += p[i] == first ? 0 : size;
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

bool place(const Images& images, const Pixels& events, i64 from, i64 to, i64* places) {
    const i16 *x = events.x.part(from, to).data(), *y = events.y.part(from, to).data();
    i64 count = to - from;
    i16 right = last_of(images.width), bottom = last_of(images.height);
    // larger images than 2^32 pixels high and wide don't exist
    if (!best<place_pixels>(x, y, count, right, bottom, u32(images.stride), places)) return false;
    if (!events.p.data()) return true;
    const u8* p = events.p.part(from, to).data();
    if (events.image != Polarity::same_image)
        best<choose_images>(p, count, events.image == Polarity::on_first, images.size, places);
    return best<are_bits>(p, count);
}

void define_inside(nb::module_& module) { define<inside>(module, "inside"); }

}  // namespace nvsdata
