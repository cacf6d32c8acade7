// Inhibition: only one pixel of a block may fire (eq. 3.5).
#pragma once

#include <cmath>
#include <vector>

#include "../native/levels.h"
#include "tiles.h"

namespace nvsdata {

inline bool touches(Rows<const bool> active, Box box) {
    bool found = false;
    for (i64 r = box.top / TILE_ROWS; r <= (box.bottom - 1) / TILE_ROWS; ++r)
        for (i64 c = box.left / TILE_COLUMNS; c <= (box.right - 1) / TILE_COLUMNS; ++c) found |= active(r, c);
    return found;
}

// Set differences to 0 in still tiles if a block extends into them, because no |d| there reaches the threshold.
template <class Number>
void clear_still(Rows<Number> difference, i64 side, Rows<const bool> active) {
    i64 height = difference.rows(), width = difference.columns();
    for (i64 r = 0; r < active.rows(); ++r)
        for (i64 c = 0; c < active.columns(); ++c) {
            if (active(r, c)) continue;
            Box box = tile_box(r, c, height, width);
            Box blocks = {box.top / side * side, std::min((box.bottom + side - 1) / side * side, height),
                          box.left / side * side, std::min((box.right + side - 1) / side * side, width)};
            if (!touches(active, blocks)) continue;
            for (i64 y = box.top; y < box.bottom; ++y)
                for (Number& d : difference[y].part(box.left, box.right)) d = 0;
        }
}

// The number if it `stays`, otherwise 0. It is computed by a mask, because loops with conditional floats aren't
// vectorized.
template <class Number>
NVSDATA_INLINE Number kept(Number value, bool stays) {
    using Bits = std::conditional_t<sizeof(Number) == 8, u64, u32>;
    return bits_of<Number>(Bits(bits_of<Bits>(value) & (Bits(0) - Bits(stays))));
}

// Blocks of 2 x 2 in a pair of rows, without branches; of equal values the first is kept.
template <class Number>
NVSDATA_INLINE void inhibit_pairs(Span<Number> upper, Span<Number> lower) {
    i64 pairs = upper.size() / 2;
    for (i64 i = 0; i < pairs; ++i) {
        Number a = upper[2 * i], b = upper[2 * i + 1], c = lower[2 * i], d = lower[2 * i + 1];
        Number m = std::abs(a), n = std::abs(b), o = std::abs(c), p = std::abs(d);
        Number upper_most = m > n ? m : n, lower_most = o > p ? o : p;
        bool above = upper_most >= lower_most, first = m >= n, third = o >= p;
        upper[2 * i] = kept(a, above & first);
        upper[2 * i + 1] = kept(b, above & !first);
        lower[2 * i] = kept(c, !above & third);
        lower[2 * i + 1] = kept(d, !above & !third);
    }
}

template <class Number>
void inhibit_by_pairs(Rows<Number> difference, Rows<const bool> active) {
    std::vector<Number> below(difference.columns());
    each_box(active, difference.rows(), difference.columns(), [&](Box box) {
        for (i64 y = box.top; y < box.bottom; y += 2) {
            Span<Number> upper = difference[y].part(box.left, box.right), lower(below.data(), upper.size());
            // a block at the border has fewer pixels
            if (y + 1 < box.bottom)
                lower = difference[y + 1].part(box.left, box.right);
            else
                std::fill(lower.begin(), lower.end(), Number(0));
            best<inhibit_pairs<Number>>(upper, lower);
            if (upper.size() % 2) (std::abs(upper.back()) >= std::abs(lower.back()) ? lower : upper).back() = 0;
        }
    });
}

// Keep the largest |d| (the first, if several are equal) of each `side` x `side` block. Blocks count from the corner.
template <class Number>
void inhibit(Rows<Number> difference, i64 side, Rows<const bool> active) {
    if (side == 2) return inhibit_by_pairs(difference, active);  // no such block extends across tiles
    if (TILE_ROWS % side) clear_still(difference, side, active);
    i64 height = difference.rows(), width = difference.columns();
    for (i64 top = 0; top < height; top += side)
        for (i64 left = 0; left < width; left += side) {
            Box box = {top, std::min(top + side, height), left, std::min(left + side, width)};
            if (!touches(active, box)) continue;
            Number most = -1;
            Number* best = nullptr;
            for (i64 y = box.top; y < box.bottom; ++y)
                for (Number& d : difference[y].part(box.left, box.right))
                    if (std::abs(d) > most) {
                        most = std::abs(d);
                        best = &d;
                    }
            for (i64 y = box.top; y < box.bottom; ++y)
                for (Number& d : difference[y].part(box.left, box.right))
                    if (&d != best) d = 0;
        }
}

}  // namespace nvsdata
