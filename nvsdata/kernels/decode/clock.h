// Times from counters that wrap, and detection of impossible times.
//
// A counter of few bits determines a time only up to a multiple of its wrap. A record gets the possible time that is
// nearest to the time of the record before it, at most half a wrap earlier or later, so a damaged word changes the time
// of no other event. Cameras write events nearly in order, and noise events without long pauses. So a decrease by more
// than `BACK_US` or to a negative time is damage, and so is a step across a wrap of more than `SILENT_US`.
#pragma once

#include "../native/require.h"
#include "../native/times.h"
#include "../native/wrap.h"

namespace nvsdata {

constexpr i64 BACK_US = 100'000;
// Because of noise, no camera sends nothing for longer: a longer pause across a wrap comes from a damaged word. Within
// a wrap, a pause of any length is accepted, because it changes the time of no other event.
constexpr i64 SILENT_US = 300'000'000;
constexpr i64 WRAP_US = i64(1) << 32;     // wrap of a 32-bit counter of µs
constexpr i64 UNKNOWN = -LATEST;          // the time before a counter's first word

// The time nearest to the time `last` at which a counter of `bits` bits (1 to 62) has the value `raw`.
inline i64 nearest(i64 raw, i64 last, int bits) {
    i64 half = i64(1) << (bits - 1);
    return plus(last, (plus(minus(raw, last), half) & (2 * half - 1)) - half);
}

// The time of a first word: its value, or -1 if it has 28 or more ones, as erased memory has.
inline i64 first_time(i64 raw, int bits) { return bits > 12 && raw == (i64(1) << bits) - 1 ? -1 : raw; }

// True if no camera continues at `after`: more than `back` earlier, below 0, or across a wrap by more than `silent`.
inline bool is_jump(i64 before, i64 after, int bits, i64 back, i64 silent) {
    i64 step = minus(after, before);
    return step < -back || after < 0 || (step > silent && after >> bits != before >> bits);
}

// Number of records from a record up to the beginning of the next block. Blocks have `block` records.
inline i64 to_next_block(i64 record, i64 block) {
    require(record >= 0 && block >= 1, "records count from 0, and a block has at least one");
    return (block - record % block) % block;
}

// The state of a 32-bit counter after some records, an int64 [8] array in Python.
class Clock {
public:
    explicit Clock(Span<i64> state) : state_(state) {
        require(state.size() == 8, "a clock's state has 8 numbers");
    }
    i64& last() const { return state_[0]; }    // time of the last record
    i64& begun() const { return state_[1]; }   // time of the last record that began a block
    i64& dense() const { return state_[2]; }   // 1 if that block began with many events
    i64& fell() const { return state_[3]; }    // 1 if times decreased
    i64& next() const { return state_[4]; }    // number of the next record
    i64& jump() const { return state_[5]; }    // number of the first record with an impossible time, or -1
    i64& hidden() const { return state_[6]; }  // number of the first record after a block too long for the index, or -1
    i64& mixed() const { return state_[7]; }   // 1 if records other than events were seen

    // Set the time from the counter's first word, unless it is known.
    void begin(i64 raw) const;
    // Turn words of the counter into times in place, and advance the state. O(N).
    void unwrap(Span<i64> t, i64 block) const;
    // Advance the state by records whose times never decrease and span less than half a wrap.
    void go_evenly(Span<const i64> t, i64 block) const;

private:
    void pass_blocks(Span<const i64> t, i64 block) const;

    Span<i64> state_;
};

}  // namespace nvsdata
