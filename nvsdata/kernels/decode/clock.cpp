// Times of counters that wrap; see clock.h.
#include "clock.h"

#include <algorithm>
#include <numeric>
#include <vector>

#include "../native/bind.h"
#include "../native/interrupt.h"
#include "../native/levels.h"
#include "../native/require.h"
#include "extremes.h"

namespace nvsdata {

namespace {

// An index computes the duration of a block, up to a multiple of the wrap, from the first words of this block and the
// next. It reads all words of a block that seems to last longer than SOON_US, or 0 µs, or whose first PEEK records
// exceed PEEK_US.
constexpr i64 SOON_US = 1 << 26, PEEK = 16, PEEK_US = 100'000;
constexpr i64 OFTEN = 1 << 14;   // records between two polls for Ctrl-C
constexpr i64 TOGETHER = 512;    // words that are processed together

// Steps in time between successive words of a 32-bit counter.
struct Steps {
    i64 words[TOGETHER + 1];
    i64 step[TOGETHER];
    int falls = 0, jumps = 0;  // not 0 if a time decreased; not 0 if no camera makes a step
};

NVSDATA_INLINE void find_steps(i64 count, Steps* steps) {
    int falls = 0, jumps = 0;
    for (i64 i = 0; i < count; ++i) {
        i64 word = steps->words[i + 1], before = steps->words[i], step = i32(u32(word) - u32(before));
        steps->step[i] = step;
        falls |= int(step < 0);
        // a step forward to a smaller word crosses a wrap
        jumps |= int(step < -BACK_US) | (int(step > SILENT_US) & int(word < before));
    }
    steps->falls |= falls;
    steps->jumps |= jumps;
}

}  // namespace

void Clock::begin(i64 raw) const {
    if (last() == UNKNOWN) last() = begun() = std::max<i64>(first_time(raw, 32), 0);
}

void Clock::unwrap(Span<i64> t, i64 block) const {
    if (t.empty()) return;
    begin(t[0]);
    i64 time = last(), lowest = 0;
    Steps steps;
    steps.words[0] = time & (WRAP_US - 1);
    for (i64 from = 0; from < t.size(); from += TOGETHER) {
        Span<i64> part = t.part(from, std::min(from + TOGETHER, t.size()));
        std::copy(part.begin(), part.end(), steps.words + 1);
        best<find_steps>(part.size(), &steps);
        for (i64 i = 0; i < part.size(); ++i) {
            part[i] = time = plus(time, steps.step[i]);
            lowest = std::min(lowest, time);
        }
        steps.words[0] = steps.words[part.size()];
    }
    if (steps.falls) fell() = 1;
    if ((steps.jumps || lowest < 0) && jump() < 0) {
        i64 i = 0, before = last();
        for (; i < t.size() && !is_jump(before, t[i], 32, BACK_US, SILENT_US); ++i) before = t[i];
        jump() = plus(next(), i);
    }
    pass_blocks(t, block);
}

void Clock::go_evenly(Span<const i64> t, i64 block) const {
    if (t.empty()) return;
    begin(t[0]);
    if (t[0] < last()) fell() = 1;
    if (is_jump(last(), t[0], 32, BACK_US, SILENT_US) && jump() < 0) jump() = next();
    pass_blocks(t, block);
}

void Clock::pass_blocks(Span<const i64> t, i64 block) const {
    i64 first = next();
    // u64, because `i + block` may exceed an i64
    for (u64 i = u64(to_next_block(first, block)); i < u64(t.size()); i += u64(block)) {
        i64 here = i64(i);
        // the time between the first words of the last block and of this one, as an index sees it
        i64 shown = minus(nearest(t[here], begun(), 32), begun());
        bool differs = shown != minus(t[here], begun());
        if (dense() && differs && 0 < shown && shown <= SOON_US && hidden() < 0) hidden() = plus(first, here);
        begun() = t[here];
        dense() = here + PEEK <= t.size() && minus(t[here + PEEK - 1], t[here]) <= PEEK_US;
    }
    last() = t.back();
    next() = plus(first, t.size());
}

void unwrap(Span<i64> state, Span<i64> t, i64 block) { Clock(state).unwrap(t, block); }

void go_evenly(Span<i64> state, Span<const i64> t, i64 block) { Clock(state).go_evenly(t, block); }

std::pair<i64, bool> lasting(Span<const u32> raw) {
    if (raw.empty()) return {0, false};
    i64 time = raw[0];
    bool damaged = false;
    for (i64 i = 1; i < raw.size(); ++i) {
        i64 step = i32(raw[i] - raw[i - 1]);
        time += step;  // fits: the array would have to have 2^32 words
        damaged |= step > SILENT_US && raw[i] < raw[i - 1];
    }
    return {time - raw[0], damaged};
}

void extremes(Span<const i64> t, i64 block, Span<i64> starts, Span<i64> lowest, Span<i64> highest) {
    to_next_block(0, block);
    i64 count = t.size() / block + (t.size() % block != 0);
    require(std::min({starts.size(), lowest.size(), highest.size()}) >= count,
            "there are more blocks than places for their times");
    for (i64 k = 0; k < count; ++k) {
        Span<const i64> part = t.part(k * block, std::min(block, t.size() - k * block) + k * block);
        starts[k] = part[0];
        best<find_extremes>(part, &lowest[k], &highest[k]);
    }
}

namespace {

// A counter, and by how much it may decrease or pause, in its units.
struct Counter {
    int bits;
    i64 back, silent;
};

// Words without a jump between them, which are kept or dropped together.
struct Run {
    i64 first, last;  // words
    i64 span = 0;     // time from the first to the last
    i64 weight = 0;   // number of words
};

// The heaviest chain of runs without a jump between them. O(runs log runs).
class Chains {
public:
    Chains(const std::vector<Run>& all, const Counter& counter)
        : runs_(all), counter_(counter), size_(i64(all.size())), total_(all.size()), end_(all.size()),
          best_(2 * all.size(), NONE) {}

    // Start times of the runs of the chain; UNKNOWN for the others.
    std::vector<i64> heaviest(Interrupt& interrupt) {
        i64 half = i64(1) << (counter_.bits - 1), wrap = 2 * half, ahead = half - 1;
        std::vector<i64> order(size_), rank(size_), ends(size_), time(size_);
        std::vector<i64> before(size_, NONE), chosen(size_, UNKNOWN);
        std::iota(order.begin(), order.end(), 0);
        std::stable_sort(order.begin(), order.end(), [&](i64 a, i64 b) { return runs_[a].last < runs_[b].last; });
        for (i64 k = 0; k < size_; ++k) {
            ends[k] = runs_[order[k]].last;
            rank[order[k]] = k;
        }
        i64 top = NONE;
        for (i64 k = 0; k < size_; ++k) {
            if (k % OFTEN == 0) interrupt.poll();
            i64 word = runs_[k].first;
            // last words that a run may follow: in the same wrap, the previous one and, for a decrease, the next one
            const std::pair<i64, i64> ranges[] = {
                {word - ahead, plus(word, counter_.back)},
                {minus(word + wrap, std::min(counter_.silent, ahead)), wrap - 1},
                {0, plus(word - wrap, counter_.back)},
            };
            for (auto [low, high] : ranges) {
                i64 lo = std::lower_bound(ends.begin(), ends.end(), low) - ends.begin();
                i64 hi = std::upper_bound(ends.begin(), ends.end(), high) - ends.begin();
                before[k] = best_of(lo, hi, before[k]);
            }
            if (before[k] >= 0) {
                time[k] = nearest(word, end_[before[k]], counter_.bits);
                total_[k] = total_[before[k]] + runs_[k].weight;
            } else if (first_time(word, counter_.bits) >= 0) {
                // a first word of all ones begins no chain
                time[k] = word;
                total_[k] = runs_[k].weight;
            } else {
                continue;
            }
            end_[k] = plus(time[k], runs_[k].span);
            // prefer a last word that continues to one far ahead
            bool heavier = top < 0 || total_[k] > total_[top];
            if (heavier || (total_[k] == total_[top] && end_[k] < end_[top])) top = k;
            for (i64 i = rank[k] + size_; i > 0; i >>= 1)
                if (is_better(k, best_[i])) best_[i] = k;
        }
        for (; top >= 0; top = before[top]) chosen[top] = time[top];
        return chosen;
    }

private:
    static constexpr i64 NONE = -1;

    // True if chain `k` is heavier than `other`, or as heavy and nearer to the next run.
    bool is_better(i64 k, i64 other) const {
        if (k < 0 || other < 0) return k >= 0;
        return total_[k] != total_[other] ? total_[k] > total_[other] : end_[k] > end_[other];
    }

    // The best of the chain `found` and of those at the tree's leaves lo..hi.
    i64 best_of(i64 lo, i64 hi, i64 found) const {
        for (lo += size_, hi += size_; lo < hi; lo >>= 1, hi >>= 1) {
            if (lo & 1) found = is_better(best_[lo], found) ? best_[lo] : found, ++lo;
            if (hi & 1) --hi, found = is_better(best_[hi], found) ? best_[hi] : found;
        }
        return found;
    }

    const std::vector<Run>& runs_;
    Counter counter_;
    i64 size_;
    std::vector<i64> total_, end_;  // of the best chain that ends with each run: number of words, last time
    std::vector<i64> best_;         // a tree over the runs by their last words: the best chain so far in each range
};

}  // namespace

void kept_words(Span<const i64> raw, int bits, i64 back, i64 silent, Span<bool> keep) {
    require(bits >= 1 && bits <= 61, "a counter has 1 to 61 bits");
    require(keep.size() == raw.size(), "the mask has another length than the words");
    Interrupt interrupt;
    i64 mask = (i64(1) << bits) - 1;
    std::vector<Run> runs;
    std::vector<i64> run(raw.size()), since(raw.size());
    for (i64 i = 0, before = 0; i < raw.size(); ++i) {
        if (i % OFTEN == 0) interrupt.poll();
        i64 word = raw[i] & mask, step = nearest(word, before, bits) - before;
        bool alone = first_time(word, bits) < 0 || first_time(before, bits) < 0;
        if (i == 0 || alone || std::abs(step) > back)
            runs.push_back({word, word});
        else
            since[i] = plus(since[i - 1], step);
        run[i] = i64(runs.size()) - 1;
        runs.back().last = before = word;
        runs.back().span = since[i];
        ++runs.back().weight;
    }
    std::vector<i64> time = Chains(runs, {bits, back, silent}).heaviest(interrupt);
    for (i64 i = 0; i < raw.size(); ++i) {
        if (i % OFTEN == 0) interrupt.poll();
        keep[i] = time[run[i]] != UNKNOWN && plus(time[run[i]], since[i]) >= 0;
    }
}

void define_clock(nb::module_& module) {
    module.attr("BACK_US") = BACK_US;
    module.attr("SILENT_US") = SILENT_US;
    module.attr("WRAP_US") = WRAP_US;
    module.attr("LATEST") = LATEST;
    module.attr("UNKNOWN") = UNKNOWN;
    module.attr("SOON_US") = SOON_US;
    module.attr("PEEK") = PEEK;
    module.attr("PEEK_US") = PEEK_US;
    define<nearest>(module, "nearest");
    define<first_time>(module, "first_time");
    define<is_jump>(module, "is_jump");
    define<unwrap>(module, "unwrap");
    define<go_evenly>(module, "go_evenly");
    define<lasting>(module, "lasting");
    define<extremes>(module, "extremes");
    define<kept_words>(module, "kept_words");
}

}  // namespace nvsdata
