// Prophesee EVT2 and EVT 2.1 words to event columns and back; see evt2.py.
#include "../native/bind.h"
#include "../native/bits.h"
#include "../native/levels.h"
#include "events.h"
#include "evt.h"

namespace nvsdata {

namespace {

enum Kind : u32 { OFF, ON, TIME = 0x8 };
constexpr i64 GROUP = 32;  // pixels
constexpr int LOW = 6;     // bits of the time in an event
using Highs = High<28, LOW>;

// The half of a word that EVT2 and EVT 2.1 share, and the mask of the pixels from x on that have its event.
u32 head(u32 word) { return word; }
u32 head(u64 word) { return u32(word); }
u32 pixels(u32) { return 1; }
u32 pixels(u64 word) { return u32(word >> 32); }

u32 kind(u32 head) { return head >> 28; }
i64 high_part(u32 head) { return head & 0xFFFFFFF; }
i64 low_part(u32 head) { return head >> 22 & 0x3F; }
i64 column(u32 head) { return head >> 11 & 0x7FF; }
i64 row(u32 head) { return head & 0x7FF; }

// The high part of the time, an array of one number in Python.
struct State {
    i64 high;

    explicit State(Span<const i64> numbers) {
        require(numbers.size() == 1, "a state is one number");
        high = numbers[0];
    }
    void keep(Span<i64> numbers) const { numbers[0] = high; }
    bool has_time() const { return high >= 0; }
    // Process word i of a piece, which is a time word.
    void take_high(u32 word, i64 i, Seen& seen) {
        i64 before = std::exchange(high, Highs::next(high, high_part(word)));
        if (Highs::is_jump(before, high)) seen.note_jump(i);
    }
    i64 time(u32 word) const { return plus(high, low_part(word)); }
};

}  // namespace

template <class Word>
void evt2_walk(Span<const u8> raw, i64 block, Span<i64> state, Span<i64> seen, Rows<i64> states, Span<i64> times) {
    require(states.columns() == 1 && times.size() == states.rows(), "a state is one number");
    Words<Word> words(raw);
    State now(state);
    Seen noted(seen);
    auto begin = [&](i64 number) {
        now.keep(states[number]);
        times[number] = noted.last;
    };
    auto is_event = [&](i64 i) { return kind(head(words[i])) <= ON && pixels(words[i]); };
    auto time = [&](i64 i) { return now.time(head(words[i])); };
    by_blocks(words.size(), block, noted.words, times.size(), begin, [&](i64 start, i64 stop) {
        for (i64 i = start; i < stop; ++i) {
            u32 word = head(words[i]);
            if (kind(word) == TIME) {
                now.take_high(word, i, noted);
            } else if (now.has_time() && is_event(i)) {
                // all events of the high part
                noted.begin(time(i));
                noted.event(time(i));
                for (; i + 1 < stop && is_event(i + 1); ++i) noted.event(time(i + 1));
            }
        }
    });
    now.keep(state);
    noted.keep(seen, words.size());
}

Found evt2_decode(Span<const u8> raw, i64 width, i64 height, Span<i64> state, Span<i64> seen, i64 kept, Span<i64> t,
                  Span<i16> x, Span<i16> y, Span<u8> p) {
    Words<u32> words(raw);
    Columns out{t, x, y, p, kept, words.size()};
    State now(state);
    Seen noted(seen);
    i64 bad = -1, count = 0;
    for (i64 i = 0; i < words.size(); ++i) {
        u32 word = words[i];
        if (kind(word) == TIME) now.take_high(word, i, noted);
        // without a branch: a word that is no event is overwritten; `count` is at most i
        out.t[count] = now.time(word);
        out.x[count] = i16(column(word));
        out.y[count] = i16(row(word));
        out.p[count] = u8(kind(word));
        bool event = (kind(word) <= ON) & now.has_time();
        if (event && (column(word) >= width || row(word) >= height) && bad < 0) bad = i;
        count += event;
    }
    now.keep(state);
    noted.keep(seen, words.size());
    return {count, bad};
}

NVSDATA_INLINE void evt21_add(Span<const u8> raw, i64* count) {
    Words<u64> words(raw);
    i64 sum = 0;
    for (i64 i = 0; i < words.size(); ++i) sum += kind(head(words[i])) <= ON ? ones(pixels(words[i])) : 0;
    *count += sum;
}

i64 evt21_count(Span<const u8> raw) {
    i64 count = 0;
    best<evt21_add>(raw, &count);
    return count;
}

Found evt21_decode(Span<const u8> raw, i64 width, i64 height, Span<i64> state, Span<i64> seen, i64 kept, Span<i64> t,
                   Span<i16> x, Span<i16> y, Span<u8> p) {
    Words<u64> words(raw);
    i64 room = minus(t.size(), kept), bad = -1, count = 0;
    Columns out{t, x, y, p, kept, room};
    State now(state);
    Seen noted(seen);
    for (i64 i = 0; i < words.size(); ++i) {
        u32 word = head(words[i]);
        if (kind(word) == TIME) {
            now.take_high(word, i, noted);
        } else if (kind(word) <= ON && now.has_time()) {
            require(ones(pixels(words[i])) <= room - count, "columns are too short for the events");
            for (u32 mask = pixels(words[i]); mask; mask &= mask - 1, ++count) {
                // at most 2078
                i64 at = column(word) + trailing_zeros(mask);
                if ((at >= width || row(word) >= height) && bad < 0) bad = i;
                out.t[count] = now.time(word);
                out.x[count] = i16(at);
                out.y[count] = i16(row(word));
                out.p[count] = u8(kind(word));
            }
        }
    }
    now.keep(state);
    noted.keep(seen, words.size());
    return {count, bad};
}

template <class Word>
i64 evt2_triggers(Span<const u8> raw, Span<i64> state, Span<i64> t, Span<u8> channel, Span<u8> level) {
    require(channel.size() == t.size() && level.size() == t.size(), "columns must be equally long");
    Words<Word> words(raw);
    State now(state);
    i64 kept = 0;
    for (i64 i = 0; i < words.size(); ++i) {
        u32 word = head(words[i]);
        if (kind(word) <= ON) continue;
        if (kind(word) == TIME) {
            now.high = Highs::next(now.high, high_part(word));
        } else if (kind(word) == TRIGGER && now.has_time() && kept < t.size()) {
            t[kept] = now.time(word);
            channel[kept] = word >> 8 & 0x1F;
            level[kept++] = word & 1;
        }
    }
    now.keep(state);
    return kept;
}

namespace {

// Writes the high part of the times.
template <class Put>
void show(i64& high, i64 t, Put put) {
    while (high != t >> LOW) {
        high = shown_next(high, t >> LOW, 28);
        put(i64(TIME) << 28 | (high & 0xFFFFFFF));
    }
}

i64 event_word(i64 t, i64 x, i64 y, i64 p) { return i64(u64(p) << 28 | u64(t & 0x3F) << 22 | u64(x) << 11 | u64(y)); }

}  // namespace

void evt2_encode(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<i64> state,
                 Span<u32> words) {
    Events events{t, x, y, p};
    Writer<u32> writer(words);
    State now(state);
    for (i64 i = 0; i < events.size(); ++i) {
        show(now.high, t[i], [&](i64 word) { writer.put(word); });
        writer.put(event_word(t[i], x[i], y[i], p[i]));
    }
    now.keep(state);
}

i64 evt21_encode(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<i64> state,
                 Span<u32> words) {
    Events events{t, x, y, p};
    Writer<u32> writer(words);
    State now(state);
    for (i64 i = 0; i < events.size();) {
        show(now.high, t[i], [&](i64 word) {
            writer.put(word);
            writer.put(0);
        });
        i64 base = x[i] & -GROUP;
        writer.put(event_word(t[i], base, y[i], p[i]));
        u32 mask = u32(1) << (x[i] - base);
        // adjacent pixels follow in their order, so that reading restores it
        for (++i; i < t.size() && t[i] == t[i - 1] && y[i] == y[i - 1] && p[i] == p[i - 1] && x[i] > x[i - 1] &&
                  x[i] < base + GROUP;
             ++i)
            mask |= u32(1) << (x[i] - base);
        writer.put(mask);
    }
    now.keep(state);
    return writer.count();
}

void define_evt2(nb::module_& module) {
    define<evt2_walk<u32>>(module, "evt2_walk");
    define<evt2_decode>(module, "evt2_decode");
    define<evt2_triggers<u32>>(module, "evt2_triggers");
    define<count_triggers<u32>>(module, "evt2_count_triggers");
    define<evt2_encode>(module, "evt2_encode");
    define<evt2_walk<u64>>(module, "evt21_walk");
    define<evt21_count>(module, "evt21_count");
    define<evt21_decode>(module, "evt21_decode");
    define<evt2_triggers<u64>>(module, "evt21_triggers");
    define<count_triggers<u64>>(module, "evt21_count_triggers");
    define<evt21_encode>(module, "evt21_encode");
}

}  // namespace nvsdata
