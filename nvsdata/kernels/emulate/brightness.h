// The brightness of pixels: luminance of bytes, and logarithms.
#pragma once

#include <vector>

#include "../native/levels.h"
#include "../native/span.h"

namespace nvsdata {

constexpr i64 TABLE_SIZE = 255'001;  // luminance in thousandths: 299 r + 587 g + 114 b
constexpr i64 BYTES = 256;

// Luminance of colors, in thousandths. `first_weight` of the first byte of three: 299 for r, g, b, 114 for b, g, r.
void weigh(Span<const u8> row, i64 first_weight, Span<i32> thousandths);

// `out` = ln q if q > t_log, otherwise slope q, for brightness q in thousandths (eq. 3.1), with an error of at most
// 4e-7.
template <class Thousandths>
void logarithm(Span<const Thousandths> thousandths, float t_log, float slope, Span<float> out);

// Throws std::invalid_argument unless pixels have one byte, or three bytes with weights, and a table of this size has a
// value for each brightness. Colors need no table if logarithms are computed.
void check_light(i64 bytes, i64 first_weight, i64 table, bool calculated);

template <class Place, class Number>
NVSDATA_INLINE void copy_from(Span<const Place> places, Span<const Number> table, Span<Number> out) {
    for (i64 i = 0; i < out.size(); ++i) out[i] = table[i32(places[i])];
}

// `out` = the values of the table at `places`, all of which `check_light` has checked.
template <class Place, class Number>
void look_up(Span<const Place> places, Span<const Number> table, Span<Number> out) {
    best<copy_from<Place, Number>>(places, table, out);
}

// ln(q + dark) of pixels of one or three bytes, with q in thousandths, by a table or, in float32 without one, by eq.
// 3.1.
template <class Number>
class Logarithms {
public:
    Logarithms(i64 width, i64 first_weight, Span<const Number> table, i32 dark, Number t_log, Number slope)
        : first_weight_(first_weight), table_(table), dark_(dark), t_log_(t_log), slope_(slope), thousandths_(width) {}

    // Levels of the pixels of a row from `left` up to `right`.
    void operator()(Span<const u8> row, i64 left, i64 right, Span<Number> out) {
        if (row.size() == i64(thousandths_.size())) return look_up(row.part(left, right), table_, out);
        Span<i32> thousandths(thousandths_.data(), out.size());
        weigh(row.part(3 * left, 3 * right), first_weight_, thousandths);
        if constexpr (sizeof(Number) == 4) {
            if (table_.empty()) {
                if (dark_)
                    for (i32& q : thousandths) q += dark_;
                return logarithm(Span<const i32>(thousandths), t_log_, slope_, out);
            }
        }
        look_up(Span<const i32>(thousandths), table_, out);
    }

private:
    i64 first_weight_;
    Span<const Number> table_;
    i32 dark_;
    Number t_log_, slope_;
    std::vector<i32> thousandths_;
};

}  // namespace nvsdata
