// Times of counters that wrap, and times among them that no camera wrote.
//
// A counter of few bits gives a time only up to whole wraps. The time of a record is taken to be the one nearest to
// that of the record before it, at most half a wrap earlier or later: so a damaged word moves no other event. Cameras
// write events nearly in order, and noise all the time. So a step back of more than `BACK_US`, or to before time 0, is
// damage, and so is a step across a wrap that lasts longer than `SILENT_US`.
#pragma once

#include "../native/require.h"
#include "../native/times.h"
#include "../native/wrap.h"

namespace nvsdata {

constexpr i64 BACK_US = 100'000;
// No camera is silent for longer, because of its noise: a longer silence across a wrap comes from a damaged word.
// Within a wrap, where it moves no other event, a silence of any length is accepted.
constexpr i64 SILENT_US = 300'000'000;
constexpr i64 WRAP_US = i64(1) << 32;     // wrap of a 32-bit counter of µs
constexpr i64 UNKNOWN = -LATEST;          // the time before a counter's first word

// The time nearest to `last` that a counter of `bits` bits (1 to 62) shows as `raw`.
inline i64 nearest(i64 raw, i64 last, int bits) {
    i64 half = i64(1) << (bits - 1);
    return plus(last, (plus(minus(raw, last), half) & (2 * half - 1)) - half);
}

// The time of a first word: its value, but -1 for 28 ones or more, which is what lost memory holds.
inline i64 first_time(i64 raw, int bits) { return bits > 12 && raw == (i64(1) << bits) - 1 ? -1 : raw; }

// True if no camera continues at `after`: over `back` earlier, before 0, or across a wrap by over `silent`.
inline bool is_jump(i64 before, i64 after, int bits, i64 back, i64 silent) {
    i64 step = minus(after, before);
    return step < -back || after < 0 || (step > silent && after >> bits != before >> bits);
}

// Number of records up to the next first record of a block, of `block` records each, from a record on.
inline i64 to_next_block(i64 record, i64 block) {
    require(record >= 0 && block >= 1, "records count from 0, and a block has at least one");
    return (block - record % block) % block;
}

// The state of a 32-bit counter after some records: an array of Python's, int64 [8].
class Clock {
public:
    explicit Clock(Span<i64> state) : state_(state) {
        require(state.size() == 8, "a clock's state has 8 numbers");
    }
    i64& last() const { return state_[0]; }    // time of the last record
    i64& begun() const { return state_[1]; }   // time of the last record that began a block
    i64& dense() const { return state_[2]; }   // 1 if that block began with many events
    i64& fell() const { return state_[3]; }    // 1 if times fell
    i64& next() const { return state_[4]; }    // number of the next record
    i64& jump() const { return state_[5]; }    // number of the first record that no camera wrote, or -1
    i64& hidden() const { return state_[6]; }  // that of the first after a block longer than an index can see, or -1
    i64& mixed() const { return state_[7]; }   // 1 if records other than events were seen

    // Set the time from the counter's first word, unless it is known.
    void begin(i64 raw) const;
    // Turn words of the counter into times in place, and advance the state. O(N).
    void unwrap(Span<i64> t, i64 block) const;
    // Advance the state by records of times that never fall and span less than half a wrap.
    void go_evenly(Span<const i64> t, i64 block) const;

private:
    void pass_blocks(Span<const i64> t, i64 block) const;

    Span<i64> state_;
};

}  // namespace nvsdata
