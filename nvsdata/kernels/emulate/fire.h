// Events from differences of brightness (thesis, section 3.2.2).
#pragma once

#include <cmath>
#include <vector>

#include "../native/levels.h"
#include "../native/random.h"
#include "keys.h"
#include "tiles.h"

namespace nvsdata {

enum Timing { INTERPOLATED, RANDOM, AT_ONCE };

template <class Number>
NVSDATA_INLINE void mark_fired(Span<const Number> difference, Number threshold, Span<u8> mark) {
    for (i64 i = 0; i < mark.size(); ++i) mark[i] = std::abs(difference[i]) >= threshold;
}

// For positions that fire: |d| in thresholds, number of events, lower half of their keys; number of all events.
template <class Number>
NVSDATA_INLINE void count_events(Span<const Number> difference, Span<const u16> x, Number threshold, i32 most, u32 row,
                                 Span<Number> ratio, Span<i32> count, Span<u32> low, i64* total) {
    i64 m = x.size(), sum = 0;
    for (i64 j = 0; j < m; ++j) ratio[j] = difference[x[j]];
    for (i64 j = 0; j < m; ++j) {
        Number signed_ratio = ratio[j] / threshold;
        low[j] = row | u32(x[j]) << 1 | u32(signed_ratio > 0);
        ratio[j] = std::abs(signed_ratio);
    }
    Number top = largest_i32<Number>;
    for (i64 j = 0; j < m; ++j) count[j] = std::min(i32(ratio[j] < top ? ratio[j] : top), most);
    for (i64 j = 0; j < m; ++j) sum += count[j];
    *total = sum;
}

// Times of the first three events of positions, k span / ratio; times beyond the span are ignored.
template <class Number, class Time>
NVSDATA_INLINE void three_times(Span<const Number> ratio, Time span, Span<u32> first, Span<u32> second,
                                Span<u32> third) {
    Time top = largest_i32<Time>, half = Time(0.5);
    for (i64 j = 0; j < ratio.size(); ++j) {
        Time step = span / ratio[j], a = step + half, b = a + step, c = b + step;
        first[j] = u32(i32(a < top ? a : top));
        second[j] = u32(i32(b < top ? b : top));
        third[j] = u32(i32(c < top ? c : top));
    }
}

template <class Number, class Time>
NVSDATA_INLINE void gaps(Span<const Number> ratio, Time span, Span<Time> gap) {
    for (i64 j = 0; j < ratio.size(); ++j) gap[j] = span / ratio[j];
}

// Finds the events in rows of differences. `Time` is the type in which times are computed.
template <class Number, class Time>
class Fire {
public:
    Fire(i64 width, Number threshold, i64 most, Timing timing, i64 span, u64 seed)
        : threshold_(threshold),
          most_(i32(std::min<i64>(most, 0x7FFFFFFF))),
          timing_(timing),
          span_(span),
          seed_(seed),
          marks_(width),
          ratio_(width),
          gap_(width),
          count_(width),
          low_(width),
          first_(width),
          second_(width),
          third_(width) {}

    // Add events where |difference| >= threshold in active tiles, (3.6) and (3.8), in raster order.
    // `difference` begins at row `top` of the frame. Times are k span / |d| for the k-th of a position (INTERPOLATED),
    // random, or 0. O(active pixels + events).
    void operator()(Rows<const Number> difference, i64 top, Rows<const bool> active, Keys& keys) {
        for (i64 y = 0; y < difference.rows(); ++y)
            if (i64 m = fired(difference[y], active[y / TILE_ROWS])) write(difference[y], u32(top + y) << 17, m, keys);
    }

private:
    Number threshold_;
    i32 most_;
    Timing timing_;
    i64 span_;
    u64 seed_;
    RowMarks marks_;
    std::vector<Number> ratio_;
    std::vector<Time> gap_;
    std::vector<i32> count_;
    std::vector<u32> low_, first_, second_, third_;

    i64 fired(Span<const Number> difference, Span<const bool> active) {
        return marks_.list(active, difference.size(), [&](i64 left, i64 right, Span<u8> mark) {
            best<mark_fired<Number>>(difference.part(left, right), threshold_, mark);
        });
    }

    void write(Span<const Number> difference, u32 row, i64 m, Keys& keys) {
        Span<const u16> x(marks_.place.data(), m);
        Span<Number> ratio(ratio_.data(), m);
        Span<const i32> count(count_.data(), m);
        Span<const u32> low(low_.data(), m);
        i64 total = 0;
        best<count_events<Number>>(difference, x, threshold_, most_, row, ratio, Span<i32>(count_.data(), m),
                                   Span<u32>(low_.data(), m), &total);
        u64* out = keys.room(total + FEW);
        if (timing_ == INTERPOLATED && most_ <= FEW)
            write_three(ratio, count, low, out);
        else
            write_all(ratio, count, low, out);
        keys.add(total);
    }

    void write_three(Span<const Number> ratio, Span<const i32> count, Span<const u32> low, u64* out) {
        i64 m = ratio.size();
        Span<u32> first(first_.data(), m), second(second_.data(), m), third(third_.data(), m);
        best<three_times<Number, Time>>(ratio, Time(span_), first, second, third);
        // all three are always written; the next position overwrites the unused ones
        for (i64 j = 0; j < m; ++j) {
            out[0] = u64(first[j]) << 32 | low[j];
            out[1] = u64(second[j]) << 32 | low[j];
            out[2] = u64(third[j]) << 32 | low[j];
            out += count[j];
        }
    }

    void write_all(Span<const Number> ratio, Span<const i32> count, Span<const u32> low, u64* out) {
        if (timing_ == INTERPOLATED) {
            Span<Time> gap(gap_.data(), ratio.size());
            best<gaps<Number, Time>>(ratio, Time(span_), gap);
            // at most about the span, because k is at most the ratio
            write_at(count, low, out,
                     [&](i64 j, i32 k) { return u64(i64(double(k + i64(1)) * double(gap[j]) + 0.5)); });
        } else if (timing_ == RANDOM) {
            write_at(count, low, out, [&](i64 j, i32 k) {
                return random_bits(seed_ + ((u64(low[j]) << 16) + u64(k) + 1) * step) % u64(span_);
            });
        } else {
            write_at(count, low, out, [](i64, i32) { return u64(0); });
        }
    }

    template <class TimeOf>
    static void write_at(Span<const i32> count, Span<const u32> low, u64* out, TimeOf time_of) {
        for (i64 j = 0; j < count.size(); ++j) {
            u64 place = low[j];
            for (i32 k = 0, n = count[j]; k < n; ++k) *out++ = time_of(j, k) << 32 | place;
        }
    }
};

}  // namespace nvsdata
