// The brightness of pixels: luminance of bytes, and logarithms.
#include "brightness.h"

#include "../native/bind.h"
#include "../native/require.h"

namespace nvsdata {

namespace {

NVSDATA_INLINE void weigh_colors(Span<const u8> row, i32 weight, i32 other, Span<i32> thousandths) {
    constexpr i64 PART = 256;
    u8 a[PART], g[PART], b[PART];
    for (i64 from = 0; from < thousandths.size(); from += PART) {
        i64 n = std::min(PART, thousandths.size() - from);
        Span<const u8> bytes = row.part(3 * from, 3 * (from + n));
        Span<i32> out = thousandths.part(from, from + n);
        // first separate the colors, because products of every third byte are vectorized less well
        for (i64 i = 0; i < n; ++i) a[i] = bytes[3 * i], g[i] = bytes[3 * i + 1], b[i] = bytes[3 * i + 2];
        for (i64 i = 0; i < n; ++i) out[i] = weight * a[i] + 587 * g[i] + other * b[i];
    }
}

constexpr u32 ROOT_HALF = 0x3F3504F3, ONE = 0x3F800000;  // bits of the square root of a half, and of 1
constexpr u32 FRACTION = (1u << 23) - 1;
// ln 2 in two parts, the first so short that its products with exponents are exact
constexpr float LN2 = 0.693359375f, LN2_REST = -2.12194440e-4f;
// ln(1 + f) = f - f^2 / 2 + f^3 (C3 + C4 f + ...), fitted to 7e-9 where 1 + f is between the square roots of 1/2 and 2
constexpr float C3 = 0.33334166f, C4 = -0.25001699f, C5 = 0.19954875f, C6 = -0.16564426f, C7 = 0.14977995f,
                C8 = -0.14379008f, C9 = 0.08672184f;

template <class Thousandths>
NVSDATA_INLINE void logarithms(Span<const Thousandths> thousandths, float limit, float slope, Span<float> out) {
    for (i64 i = 0; i < out.size(); ++i) {
        float q = float(thousandths[i]);
        // q / 1000 = (1 + f) 2^exponent, with 1 + f between these roots
        u32 moved = bits_of<u32>(q * 0.001f) + (ONE - ROOT_HALF);
        float exponent = float(i32(moved >> 23)) - 127.0f;
        float f = bits_of<float>((moved & FRACTION) + ROOT_HALF) - 1.0f;
        float tail = ((((((C9 * f + C8) * f + C7) * f + C6) * f + C5) * f + C4) * f + C3) * f * (f * f);
        float value = f + (tail + exponent * LN2_REST - 0.5f * (f * f)) + exponent * LN2;
        out[i] = q > limit ? value : q * 0.001f * slope;
    }
}

}  // namespace

void weigh(Span<const u8> row, i64 first_weight, Span<i32> thousandths) {
    best<weigh_colors>(row, i32(first_weight), i32(413 - first_weight), thousandths);
}

template <class Thousandths>
void logarithm(Span<const Thousandths> thousandths, float t_log, float slope, Span<float> out) {
    require(thousandths.size() == out.size(), "arrays of pixels differ in shape");
    // compared in thousandths, which are integers, because eq. 3.1 jumps at t_log
    best<logarithms<Thousandths>>(thousandths, 1000.0f * t_log, slope, out);
}

template void logarithm(Span<const i32>, float, float, Span<float>);
template void logarithm(Span<const float>, float, float, Span<float>);

void check_light(i64 bytes, i64 first_weight, i64 table, bool calculated) {
    require(bytes == 1 || bytes == 3, "pixels must have one byte or three");
    require(first_weight >= 0 && first_weight <= 413, "weights must lie between 0 and 413");
    bool needless = bytes == 3 && calculated && table == 0;
    require(needless || table >= (bytes == 1 ? BYTES : TABLE_SIZE), "the table is too short");
}

template <class Thousandths>
void logarithm_of(Span<const Thousandths> thousandths, double t_log, double slope, Span<float> out) {
    logarithm(thousandths, float(t_log), float(slope), out);
}

void define_brightness(nb::module_& module) {
    define<logarithm_of<i32>, logarithm_of<float>>(module, "logarithm");
    define<level>(module, "cpu_level");
}

}  // namespace nvsdata
