// Order in time.
#include <algorithm>
#include <cmath>
#include <utility>

#include "../native/bind.h"
#include "../native/levels.h"
#include "../native/interrupt.h"
#include "events.h"
#include "extremes.h"

namespace nvsdata {

namespace {

constexpr i64 BLOCK = 4096;
constexpr int DIGIT = 11;  // bits of the times that one pass sorts
constexpr u64 MASK = (1 << DIGIT) - 1;

NVSDATA_INLINE void find_falls(Span<const i64> t, bool* falls) {
    for (i64 start = 1; start < t.size() && !*falls; start += BLOCK) {
        i64 count = 0;
        // no exit within a block, so that it is vectorized
        for (i64 i = start, stop = std::min(start + BLOCK, t.size()); i < stop; ++i) count += t[i] < t[i - 1];
        *falls = count > 0;
    }
}

// Copy indices and times, in the order of one digit.
NVSDATA_INLINE void sort_by_digit(Span<const i32> order, Span<const u64> key, int shift, Span<i32> next_order,
                                  Span<u64> next_key, Interrupt* interrupt) {
    i64 n = order.size();
    u32 places[MASK + 1] = {};  // place of the next event of each value
    for (i64 i = 0; i < n; ++i) ++places[key[i] >> shift & MASK];
    u32 begin = 0;
    for (u32& place : places) begin += std::exchange(place, begin);
    for (i64 start = 0; start < n; start += BLOCK) {
        interrupt->poll();
        for (i64 i = start, stop = std::min(start + BLOCK, n); i < stop; ++i) {
            // below n, because n events were counted
            i64 to = places[key[i] >> shift & MASK]++;
            next_order[to] = order[i];
            next_key[to] = key[i];
        }
    }
}

NVSDATA_INLINE void move(Span<const i64> t, Span<const float> moves, double sigma, i64 start, i64 end, Span<i64> out) {
    for (i64 i = 0; i < t.size(); ++i) {
        double move = std::rint(double(moves[i]) * sigma);
        double back = double(i64(u64(start) - u64(t[i]))), ahead = double(i64(u64(end) - u64(t[i])));
        // compared before the addition, which may overflow int64
        if (move >= ahead)
            out[i] = end;
        else if (move > back)
            out[i] = t[i] + i64(move);
        else
            out[i] = start;
    }
}

}  // namespace

bool is_sorted(Span<const i64> t) {
    bool falls = false;
    best<find_falls>(t, &falls);
    return !falls;
}

i64 late(Span<const i64> t, Span<i64> found) {
    i64 count = 0, n = t.size(), latest = t.empty() ? 0 : t[0];
    if (found.empty()) return 0;
    for (i64 i = 0; i < n; ++i) {
        // a separate loop, because most times increase
        for (; i < n && t[i] >= latest; ++i) latest = t[i];
        if (i < n) found[count++] = i;
        if (count == found.size()) break;
    }
    return count;
}

void merge_late(Span<const i64> late, Span<const i64> order, Span<const i64> t, Span<const i16> x, Span<const i16> y,
                Span<const u8> p, Span<i64> t_out, Span<i16> x_out, Span<i16> y_out, Span<u8> p_out) {
    Events from{t, x, y, p};
    i64 n = from.size();
    Columns to{t_out, x_out, y_out, p_out, 0, n};
    require(order.size() == late.size(), "late events must be the same in both orders");
    for (i64 i = 0; i < late.size(); ++i) {
        bool rises = late[i] > (i ? late[i - 1] : -1);
        require(rises && late[i] < n && u64(order[i]) < u64(n), "late events must be numbers of events, ascending");
    }
    // n events are written: those that aren't late, and the late ones
    i64 kept = 0, following = 0, merged = 0;
    for (i64 i = 0; i < n; ++i) {
        if (following < late.size() && late[following] == i) {
            ++following;
            continue;
        }
        for (; merged < order.size() && t[order[merged]] < t[i]; ++merged) from.copy(order[merged], to, kept++);
        from.copy(i, to, kept++);
    }
    for (; merged < order.size(); ++merged) from.copy(order[merged], to, kept++);
}

void stable_order(Span<const i64> t, Rows<i32> orders, Rows<u64> keys) {
    i64 n = t.size();
    require(orders.rows() == 2 && keys.rows() == 2 && orders.columns() == n && keys.columns() == n,
            "two numbers of each kind for each time");
    if (n == 0) return;
    Interrupt interrupt;
    i64 lowest, highest;
    best<find_extremes>(t, &lowest, &highest);
    u64 low = u64(lowest), span = u64(highest) - low;
    int passes = 0;
    while (DIGIT * passes < 64 && span >> (DIGIT * passes)) ++passes;
    // times move along, because looking them up by index is slow
    int from = passes % 2;  // the last pass writes to row 0
    for (i64 i = 0; i < n; ++i) {
        orders(from, i) = i32(i);
        keys(from, i) = u64(t[i]) - low;
    }
    for (int pass = 0; pass < passes; ++pass, from ^= 1)
        best<sort_by_digit>(Span<const i32>(orders[from]), Span<const u64>(keys[from]), DIGIT * pass, orders[from ^ 1],
                            keys[from ^ 1], &interrupt);
}

void moved(Span<const i64> t, Span<const float> moves, double sigma, i64 start, i64 end, Span<i64> out) {
    require(moves.size() == t.size() && out.size() == t.size(), "one move for each time");
    best<move>(t, moves, sigma, start, end, out);
}

void define_order(nb::module_& module) {
    define<is_sorted>(module, "is_sorted");
    define<late>(module, "late");
    define<merge_late>(module, "merge_late");
    define<stable_order>(module, "stable_order");
    define<moved>(module, "moved");
}

}  // namespace nvsdata
