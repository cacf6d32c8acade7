// Events as keys of 64 bits: µs since the last frame << 32 | y << 17 | x << 1 | ON.
//
// A frame's keys are in raster order until they are sorted.
#pragma once

#include <algorithm>
#include <cstring>
#include <memory>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "../native/require.h"
#include "../native/span.h"
#include "tiles.h"

namespace nvsdata {

constexpr i64 FEW = 3;  // events per position that are always written, even if they don't count

constexpr i64 LONGEST = i64(1) << 31;  // largest time between frames in µs that fits a key

// Throws std::invalid_argument for frames with pixels that don't fit a key.
inline void check_addresses(i64 height, i64 width) {
    require(height <= 1 << 15 && width <= 1 << 16, "the frame is too large for keys");
}

// The keys of a frame, in the array of the caller or, if that is too short, in a longer one.
class Keys {
public:
    explicit Keys(Span<u64> given) : place_(given) {}

    // The place of the next keys, with space for `more`.
    u64* room(i64 more) {
        if (more > place_.size() - count_) grow(more);
        return place_.data() + count_;
    }
    void add(i64 n) { count_ += n; }

    // The number of keys, and the longer array or None.
    using Result = std::pair<i64, nanobind::ndarray<nanobind::numpy, u64, nanobind::ndim<1>>>;
    Result result() {
        if (!longer_) return {count_, {}};
        nanobind::gil_scoped_acquire lock;
        nanobind::capsule owner(longer_.get(), [](void* data) noexcept { delete[] static_cast<u64*>(data); });
        return {count_, {longer_.release(), {std::size_t(place_.size())}, owner}};
    }

private:
    Span<u64> place_;
    i64 count_ = 0;
    std::unique_ptr<u64[]> longer_;

    void grow(i64 more) {
        i64 size = 2 * place_.size() + more;
        std::unique_ptr<u64[]> longer(new u64[std::size_t(size)]);
        std::copy(place_.data(), place_.data() + count_, longer.get());
        longer_ = std::move(longer);
        place_ = {longer_.get(), size};
    }
};

// A mark (0 or 1) per pixel of a row, up to a multiple of 8, and the list of pixels with mark 1.
struct RowMarks {
    std::vector<u8> mark;
    std::vector<u16> place;

    explicit RowMarks(i64 width) : mark(std::size_t(width + 7) / 8 * 8), place(std::size_t(width) + 8) {}

    // List the pixels that mark_run(left, right, marks) marks in the active tiles of a row; return their number.
    template <class MarkRun>
    i64 list(Span<const bool> active, i64 width, MarkRun mark_run) {
        i64 end = 0;
        each_run(active, width, [&](i64 left, i64 right) {
            clear(end, left);
            mark_run(left, right, Span<u8>(mark).part(left, right));
            end = right;
        });
        if (end == 0) return 0;
        clear(end, width);
        return list();
    }

private:
    void clear(i64 from, i64 to) { std::fill(mark.begin() + from, mark.begin() + to, u8(0)); }

    // List the pixels with mark 1; return their number.
    i64 list() {
        i64 m = 0;
        for (i64 x = 0; x < i64(mark.size()); x += 8) {
            u64 word;
            std::memcpy(&word, &mark[x], 8);
            if (word == 0) continue;
            // without branches, because it is unpredictable which of the eight fire
            for (i64 i = 0; i < 8; ++i) {
                place[m] = u16(x + i);  // m <= x + i < size, because at most one was listed per mark before
                m += mark[x + i];
            }
        }
        return m;
    }
};

// The largest i32: larger numbers and NaN can't be converted.
template <class Number>
constexpr Number largest_i32 = Number(sizeof(Number) == 8 ? 0x7FFFFFFF : 0x7FFFFF80);

// A number as an integer, limited to 0 to `most`.
template <class Integer, class Number>
inline Integer clamped(Number value, Integer most) {
    Number top = Number(most);
    return value < top ? Integer(value > 0 ? value : Number(0)) : most;
}

}  // namespace nvsdata
