// Arguments and results of decoders.
//
// A decoder takes some records of a file, as bytes, and the state before them, which it updates to the state after
// them. It fills the columns t, x, y and p (int64 µs, int16, int16, uint8) from index `kept` on. It returns the number
// of events, and the index of the first record with coordinates outside the sensor or a polarity other than 0 and 1 (-1
// if there is none). A sensor of unknown size is larger than any coordinate.
#pragma once

#include <cstring>
#include <type_traits>
#include <utility>

#include "../native/require.h"
#include "../native/span.h"

namespace nvsdata {

using Found = std::pair<i64, i64>;  // number of events; first invalid record

struct Columns {
    Span<i64> t;
    Span<i16> x, y;
    Span<u8> p;

    // Columns with space for `size` events from index `kept` on.
    Columns(Span<i64> t, Span<i16> x, Span<i16> y, Span<u8> p, i64 kept, i64 size) : t(t), x(x), y(y), p(p) {
        for (i64 room : {t.size(), x.size(), y.size(), p.size()})
            require(kept >= 0 && size >= 0 && kept <= room && size <= room - kept,
                    "columns are too short for the events");
        *this = part(kept, kept + size);
    }
    Columns(Span<i64> t, Span<i16> x, Span<i16> y, Span<u8> p) : t(t), x(x), y(y), p(p) {}
    Columns part(i64 from, i64 to) const {
        return {t.part(from, to), x.part(from, to), y.part(from, to), p.part(from, to)};
    }
};

// A decoder's state: a struct of i64 here, an int64 array in Python.
template <class State>
State load(Span<const i64> numbers) {
    static_assert(std::is_trivially_copyable_v<State> && sizeof(State) % sizeof(i64) == 0);
    require(numbers.size() == i64(sizeof(State) / sizeof(i64)),
            "the state of another decoder, of another number of values");
    State state;
    std::memcpy(&state, numbers.data(), sizeof state);
    return state;
}

// Store a state only in the array from which it was loaded.
template <class State>
void store(const State& state, Span<i64> numbers) {
    std::memcpy(numbers.data(), &state, sizeof state);
}

// The word of a little-endian file at some byte. The bytes may be at any address.
template <class Word>
Word word_at(Span<const u8> raw, i64 byte) {
    check_index(u64(byte), u64(raw.size()));
    check_index(u64(byte) + sizeof(Word) - 1, u64(raw.size()));
    Word word;
    std::memcpy(&word, raw.data() + byte, sizeof word);
    return word;
}

}  // namespace nvsdata
