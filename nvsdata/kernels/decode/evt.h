// What Prophesee's EVT encodings share: words with the high bits of the time, and what is noted while words pass. See
// evt.py.
#pragma once

#include <algorithm>

#include "../native/require.h"
#include "clock.h"
#include "columns.h"

namespace nvsdata {

constexpr i64 NO_TIME = -1;   // before the first word with high bits: events there have no time
constexpr i64 FAR_X = 32'767;  // pixels; events have x below it
constexpr i64 ROWS = 1 << 11;  // that a word can name

// Words of a file, which may lie at any address.
template <class Word>
class Words {
public:
    explicit Words(Span<const u8> raw) : raw_(raw), size_(raw.size() / i64(sizeof(Word))) {}
    i64 size() const { return size_; }
    Word operator[](i64 i) const { return word_at<Word>(raw_, i * i64(sizeof(Word))); }

private:
    Span<const u8> raw_;
    i64 size_;
};

// What was seen until now; kept in an array.
struct Seen {
    i64 last, first;  // times of the last and of the first event, -1 before any
    i64 falls;        // times that fell
    i64 words;        // before the piece
    i64 jump;         // the first word that no camera wrote, -1 if there is none

    explicit Seen(Span<const i64> seen) {
        require(seen.size() == 5, "what was seen has 5 numbers");
        last = seen[0], first = seen[1], falls = seen[2], words = seen[3], jump = seen[4];
    }
    void keep(Span<i64> seen) const {
        seen[0] = last, seen[1] = first, seen[2] = falls, seen[3] = words, seen[4] = jump;
    }
    void event(i64 time) {
        falls = plus(falls, time < last);
        last = time;
        if (first < 0) first = time;
    }
};

// The high part of the time in µs, of `bits` bits above the lowest `shift`, or NO_TIME.
template <int bits, int shift>
struct High {
    i64 value;

    bool known() const { return value >= 0; }
    i64 at(i64 low) const { return plus(value, low); }

    void go_on(i64 raw) {
        i64 now = known() ? nearest(raw, value >> shift, bits) : first_time(raw, bits);
        value = i64(u64(now) << shift);
    }
    // The same for word i of a piece, which is noted if it's the first that no camera wrote.
    void go_on(i64 raw, i64 i, Seen& seen) {
        i64 before = value;
        go_on(raw);
        bool jump = before < 0 ? value < 0 : is_jump(before, value, bits + shift, BACK_US, SILENT_US);
        if (jump && seen.jump < 0) seen.jump = plus(seen.words, i);
    }
};

// Number of ones of at most 32 bits.
inline i64 ones(u32 bits) {
    bits -= bits >> 1 & 0x55555555;
    bits = (bits & 0x33333333) + (bits >> 2 & 0x33333333);
    return ((bits + (bits >> 4)) & 0x0F0F0F0F) * 0x01010101 >> 24;
}

// Calls `pass(start, stop)` for the words of each block, of `block` words, of a piece, and before it, `begin(number)`
// for the block's number. The piece begins with a block, after `before` words, and the file has at most `blocks`.
template <class Begin, class Pass>
void by_blocks(i64 words, i64 block, i64 before, i64 blocks, Begin begin, Pass pass) {
    require(block > 0 && before >= 0 && before % block == 0, "a piece begins with a block");
    i64 number = before / block;
    require(words == 0 || (words - 1) / block < blocks - number, "more blocks than there is room for");
    for (i64 start = 0; start < words; start += block) {
        begin(number++);
        pass(start, std::min(start + block, words));
    }
}

// The high part, of `bits` bits, to write after `before` on the way to `high`, both without wraps taken off; -1 before the
// first.
inline i64 shown_next(i64 before, i64 high, int bits) {
    i64 half = i64(1) << (bits - 1), end = before | (2 * half - 1);
    return before == end ? plus(end, 1) : std::min({plus(before, half - 1), end, high});
}

// Writes words where there is room that was counted before.
template <class Word>
class Writer {
public:
    explicit Writer(Span<Word> words) : words_(words) {}
    void put(i64 word) {
        require(count_ < words_.size(), "too little room for the words");
        words_[count_++] = Word(word);
    }
    i64 count() const { return count_; }

private:
    Span<Word> words_;
    i64 count_ = 0;
};

}  // namespace nvsdata
