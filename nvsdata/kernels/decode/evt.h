// Shared parts of Prophesee's EVT encodings: words with the high bits of the time, and the facts that a walk collects.
// See evt.py.
#pragma once

#include <algorithm>

#include "../native/require.h"
#include "clock.h"
#include "columns.h"

namespace nvsdata {

constexpr u32 TRIGGER = 0xA;  // type of a word
constexpr i64 FAR_X = 32'767;  // pixels; events have x below it

// Words of a file, which may be at any address.
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

// Facts about the words so far.
struct Seen {
    i64 last, first;  // times of the last and of the first event, -1 before any
    i64 falls;        // number of decreases of time
    i64 words;        // number of words before the piece
    i64 jump;         // the first word with an impossible time, -1 if there is none

    // Fields are assigned one by one, because this keeps them in registers, unlike `load` and `store`.
    explicit Seen(Span<const i64> seen) {
        require(seen.size() == 5, "what was seen has 5 numbers");
        last = seen[0], first = seen[1], falls = seen[2], words = seen[3], jump = seen[4];
    }
    // Write the facts to an array, after a piece of `more` words.
    void keep(Span<i64> seen, i64 more) const {
        seen[0] = last, seen[1] = first, seen[2] = falls, seen[3] = plus(words, more), seen[4] = jump;
    }
    void begin(i64 time) {
        if (first < 0) first = time;
    }
    void event(i64 time) {
        falls = plus(falls, time < last);
        last = time;
    }
    // Store the number of word i of the piece if its time is the first impossible one.
    void note_jump(i64 i) {
        if (jump < 0) jump = plus(words, i);
    }
};

// High parts of the time, of `bits` bits above the lowest `shift`; in µs, -1 before the first.
template <int bits, int shift>
struct High {
    // The high part of a word with the value `raw`, after the high part `before`.
    static i64 next(i64 before, i64 raw) {
        i64 now = before >= 0 ? nearest(raw, before >> shift, bits) : first_time(raw, bits);
        return i64(u64(now) << shift);
    }
    // True if no camera continues with this word or, for a counter's first word, begins with it.
    static bool is_jump(i64 before, i64 after) {
        return before < 0 ? after < 0 : nvsdata::is_jump(before, after, bits + shift, BACK_US, SILENT_US);
    }
};

// Number of triggers: by the type, a word's highest four bits, or those of its lower half of 32.
template <class Word>
i64 count_triggers(Span<const u8> raw) {
    constexpr int SHIFT = sizeof(Word) == 2 ? 12 : 28;
    constexpr i64 BLOCK = 4096;
    Words<Word> words(raw);
    i64 count = 0;
    for (i64 start = 0; start < words.size(); start += BLOCK) {
        // with the size of a word, so that many words are counted together
        Word sum = 0;
        for (i64 i = start, stop = std::min(start + BLOCK, words.size()); i < stop; ++i)
            sum = Word(sum + (Word(words[i] >> SHIFT & 0xF) == Word(TRIGGER)));
        count += i64(sum);
    }
    return count;
}

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

// The high part, of `bits` bits, to write after `before` on the way to `high`. Both include wraps; `before` is -1 at
// the beginning.
inline i64 shown_next(i64 before, i64 high, int bits) {
    i64 half = i64(1) << (bits - 1), end = before | (2 * half - 1);
    return before == end ? plus(end, 1) : std::min({plus(before, half - 1), end, high});
}

// Writes words into an array whose size was counted before.
template <class Word>
class Writer {
public:
    explicit Writer(Span<Word> words) : words_(words) {}
    void put(i64 word) {
        require(count_ < words_.size(), "too little room for the words");
        words_[count_++] = Word(word);
    }
    // Advance by some words, and return their place.
    Span<Word> take(i64 count) {
        require(count <= words_.size() - count_, "too little room for the words");
        count_ += count;
        return words_.part(count_ - count, count_);
    }
    i64 count() const { return count_; }

private:
    Span<Word> words_;
    i64 count_ = 0;
};

}  // namespace nvsdata
