// Prophesee EVT3 words to event columns and back; see evt3.py.
#include "../native/bind.h"
#include "../native/bits.h"
#include "../native/levels.h"
#include "events.h"
#include "evt.h"

namespace nvsdata {

namespace {

enum Kind : u32 { Y, X = 0x2, BASE, VECTOR_12, VECTOR_8, LOW, HIGH = 0x8 };
// kinds that are rare or come in groups
constexpr u32 SPECIAL = 1 << BASE | 1 << VECTOR_12 | 1 << VECTOR_8 | 1 << HIGH;

u32 kind(u32 word) { return word >> 12; }
u32 polarity(u32 word) { return word >> 11 & 1; }

using Highs = High<12, 12>;

// The facts that earlier words state about an event, an array in Python.
struct State {
    i64 high, time;  // the high part of the time, and the time; the array has the low part instead of the time
    i64 row, base, polarity;

    explicit State(Span<const i64> state) {
        require(state.size() == 5, "a state has 5 numbers");
        high = state[0], time = plus(high, state[1]), row = state[2], base = state[3], polarity = state[4];
    }
    void keep(Span<i64> state) const {
        state[0] = high, state[1] = minus(time, high), state[2] = row, state[3] = base, state[4] = polarity;
    }
    bool has_time() const { return high >= 0; }
    // Process any word, without branches for kinds that come in any order.
    void take_common(u32 word) {
        row = kind(word) == Y ? word & 0x7FF : row;
        time = kind(word) == LOW ? plus(high, word & 0xFFF) : time;
    }
    void take_base(u32 word) {
        base = word & 0x7FF;
        polarity = nvsdata::polarity(word);
    }
    // Returns true if the word's time is impossible.
    bool take_high(u32 word) {
        i64 before = std::exchange(high, Highs::next(high, word & 0xFFF));
        // the current low part belongs to the previous high part
        if (high != before) time = high;
        return Highs::is_jump(before, high);
    }
};

// x may be negative, because a state may come from the index of a file.
bool outside(i64 pixel, i64 end) { return u64(pixel) >= u64(end); }
i64 vector_size(u32 word) { return kind(word) == VECTOR_12 ? 12 : 8; }

}  // namespace

void evt3_walk(Span<const u8> raw, i64 block, Span<i64> state, Span<i64> seen, Rows<i64> states, Span<i64> times) {
    require(states.columns() == 5 && times.size() == states.rows(), "a state has 5 numbers");
    Words<u16> words(raw);
    State now(state);
    Seen noted(seen);
    auto begin = [&](i64 number) {
        now.keep(states[number]);
        times[number] = noted.last;
    };
    by_blocks(words.size(), block, noted.words, times.size(), begin, [&](i64 start, i64 stop) {
        for (i64 i = start; i < stop; ++i) {
            u32 word = words[i];
            now.take_common(word);
            bool found = kind(word) == X;
            if (SPECIAL >> kind(word) & 1) {
                if (kind(word) == HIGH) {
                    if (now.take_high(word)) noted.note_jump(i);
                } else if (kind(word) == BASE) {
                    now.take_base(word);
                } else {
                    found = word & ((1 << vector_size(word)) - 1);
                    now.base = plus(now.base, vector_size(word));
                }
            }
            if (found && now.has_time()) {
                noted.begin(now.time);
                noted.event(now.time);
            }
        }
    });
    now.keep(state);
    noted.keep(seen, words.size());
}

NVSDATA_INLINE void evt3_add(Span<const u8> raw, i64* count) {
    constexpr i64 BLOCK = 4096;  // words, whose number of events fits 16 bits
    Words<u16> words(raw);
    for (i64 start = 0; start < words.size(); start += BLOCK) {
        u16 sum = 0;
        for (i64 i = start, stop = std::min(start + BLOCK, words.size()); i < stop; ++i) {
            // in 16 bits, so that many words are counted together
            u16 word = words[i], type = word >> 12;
            u16 bits = type == VECTOR_12 ? word & 0xFFF : type == VECTOR_8 ? word & 0xFF : type == X;
            bits = u16(bits - (bits >> 1 & 0x5555));
            bits = u16((bits & 0x3333) + (bits >> 2 & 0x3333));
            bits = u16((bits + (bits >> 4)) & 0x0F0F);
            sum = u16(sum + u16(bits + (bits >> 8)) % 256);
        }
        *count += sum;
    }
}

i64 evt3_count(Span<const u8> raw) {
    i64 count = 0;
    best<evt3_add>(raw, &count);
    return count;
}

Found evt3_decode(Span<const u8> raw, i64 width, i64 height, Span<i64> state, Span<i64> seen, i64 kept, Span<i64> t,
                  Span<i16> x, Span<i16> y, Span<u8> p) {
    Words<u16> words(raw);
    i64 room = minus(t.size(), kept), bad = -1, count = 0;
    Columns out{t, x, y, p, kept, room};
    State now(state);
    Seen noted(seen);
    for (i64 i = 0; i < words.size();) {
        require(count < room, "columns are too short for the events");
        // as many words as fit if each is an event
        for (i64 stop = std::min(words.size(), i + room - count); i < stop; ++i) {
            u32 word = words[i];
            now.take_common(word);
            // without branches for kinds that come in any order: a word that is no event is overwritten
            i64 column = word & 0x7FF;
            out.t[count] = now.time;
            out.x[count] = i16(column);
            out.y[count] = i16(now.row);
            out.p[count] = u8(polarity(word));
            bool event = (kind(word) == X) & now.has_time();
            if (event & (outside(column, width) | outside(now.row, height)) && bad < 0) bad = i;
            count += event;
            if (!(SPECIAL >> kind(word) & 1)) continue;
            if (kind(word) == HIGH) {
                if (now.take_high(word)) noted.note_jump(i);
            } else if (kind(word) == BASE) {
                now.take_base(word);
            } else {
                u32 bits = now.has_time() ? word & ((1 << vector_size(word)) - 1) : 0;
                require(ones(bits) <= room - count, "columns are too short for the events");
                for (; bits; bits &= bits - 1, ++count) {
                    i64 at = plus(now.base, trailing_zeros(bits));
                    if ((outside(at, width) || outside(now.row, height)) && bad < 0) bad = i;
                    out.t[count] = now.time;
                    out.x[count] = i16(std::min(at, FAR_X));
                    out.y[count] = i16(now.row);
                    out.p[count] = u8(now.polarity);
                }
                now.base = plus(now.base, vector_size(word));
                stop = std::min(stop, i + 1 + room - count);
            }
        }
    }
    now.keep(state);
    noted.keep(seen, words.size());
    return {count, bad};
}

i64 evt3_triggers(Span<const u8> raw, Span<i64> state, Span<i64> t, Span<u8> channel, Span<u8> level) {
    require(channel.size() == t.size() && level.size() == t.size(), "columns must be equally long");
    Words<u16> words(raw);
    State now(state);
    i64 kept = 0;
    for (i64 i = 0; i < words.size(); ++i) {
        u32 word = words[i];
        if (!((1 << LOW | 1 << HIGH | 1 << TRIGGER) >> kind(word) & 1)) continue;
        if (kind(word) == LOW) {
            now.time = plus(now.high, word & 0xFFF);
        } else if (kind(word) == HIGH) {
            now.take_high(word);
        } else if (now.has_time() && kept < t.size()) {
            t[kept] = now.time;
            channel[kept] = word >> 8 & 0xF;
            level[kept++] = word & 1;
        }
    }
    now.keep(state);
    return kept;
}

namespace {

// Writes the events of one row and time at increasing `x`, as vectors where these are shorter.
void write_row(Writer<u16>& writer, Span<const i16> x, i64 polarity) {
    for (i64 i = 0; i < x.size();) {
        // a base and a vector instead of three events
        if (i + 2 >= x.size() || x[i + 2] >= x[i] + 12) {
            writer.put(X << 12 | polarity | x[i++]);
            continue;
        }
        i64 base = x[i];
        writer.put(BASE << 12 | polarity | base);
        // 12, 12 and 8 pixels, as cameras do: some decoders rely on it
        for (int part = 0; part < 3; ++part) {
            i64 size = part == 2 ? 8 : 12;
            if (i == x.size() || x[i] >= base + size) break;
            u32 bits = 0;
            for (; i < x.size() && x[i] < base + size; ++i) bits |= 1 << (x[i] - base);
            writer.put((part == 2 ? VECTOR_8 : VECTOR_12) << 12 | bits);
            base += size;
        }
    }
}

}  // namespace

i64 evt3_encode(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<i64> state,
                Span<u16> words) {
    Events events{t, x, y, p};
    require(state.size() == 3, "a state has 3 numbers");
    i64 high = state[0], low = state[1], row = state[2];
    Writer<u16> writer(words);
    for (i64 i = 0, stop; i < events.size(); i = stop) {
        while (high != t[i] >> 12) {
            high = shown_next(high, t[i] >> 12, 12);
            low = -1;
            writer.put(HIGH << 12 | (high & 0xFFF));
        }
        if (low != (t[i] & 0xFFF)) writer.put(LOW << 12 | (low = t[i] & 0xFFF));
        if (row != y[i]) writer.put(Y << 12 | (row = y[i]));
        stop = i + 1;
        while (stop < t.size() && t[stop] == t[i] && y[stop] == y[i] && p[stop] == p[i] && x[stop] > x[stop - 1])
            ++stop;
        i64 polarity = i64(p[i]) << 11;
        if (stop - i < 3)
            for (i64 j = i; j < stop; ++j) writer.put(X << 12 | polarity | x[j]);
        else
            write_row(writer, x.part(i, stop), polarity);
    }
    state[0] = high, state[1] = low, state[2] = row;
    return writer.count();
}

void define_evt3(nb::module_& module) {
    define<evt3_walk>(module, "evt3_walk");
    define<evt3_count>(module, "evt3_count");
    define<evt3_decode>(module, "evt3_decode");
    define<evt3_triggers>(module, "evt3_triggers");
    define<count_triggers<u16>>(module, "evt3_count_triggers");
    define<evt3_encode>(module, "evt3_encode");
}

}  // namespace nvsdata
