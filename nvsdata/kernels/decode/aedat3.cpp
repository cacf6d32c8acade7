// Packets of AEDAT 3 files, little-endian: 28 bytes of header, then events of one type and size.
#include <algorithm>
#include <array>
#include <tuple>

#include "../native/bind.h"
#include "../native/files.h"
#include "../native/interrupt.h"
#include "../native/levels.h"
#include "clock.h"
#include "columns.h"

namespace nvsdata {

namespace {

constexpr i64 POLARITY_EVENT = 1;     // type of packets
constexpr i64 HEADER = 28;            // bytes
constexpr i64 SIZE = 8;               // bytes of a polarity event
constexpr i64 BITS_31 = i64(1) << 31; // counts are below it
constexpr i64 DISORDER_US = 1'000;    // µs by which an event may be outside the first and last time of its packet
constexpr i64 OFTEN = 1 << 10;        // packets between two polls for Ctrl-C
// Faults of a file of packets: truncated, damaged, or truncated while it was read. FULL: there are more packets than
// rows.
enum Fault { FINE, TORN, NONSENSE, CUT, FULL };

// A row of the index of polarity packets: byte of the first event, number of events, µs to add to their times, first
// and last time, 1 if the header counts fewer valid events than events.
struct Packet {
    i64 first_byte, number, added, first, last, some_invalid;
};

// The bytes of a file that were read last, at first the known ones.
class Near {
public:
    Near(Span<const u8> known, int descriptor, i64 size) : bytes_(known), descriptor_(descriptor), size_(size) {}

    // Read the words from `at` up to `end`, at most the file's size, if necessary; false if the file was truncated.
    bool reach(i64 at, i64 end) {
        if (begin_ <= at && end <= begin_ + bytes_.size()) return true;
        Span<u8> fresh(room_.data(), std::min(i64(room_.size()), size_ - at));
        begin_ = at;
        bytes_ = fresh;
        return read_at(descriptor_, at, fresh);
    }
    i64 word(i64 at) const { return word_at<u32>(bytes_, at - begin_); }

private:
    Span<const u8> bytes_;
    i64 begin_ = 0;
    int descriptor_;
    i64 size_;
    std::array<u8, 512> room_;  // enough for a small packet and the next header
};

}  // namespace

std::tuple<i64, int, i64> aedat3_packets(Span<const u8> known, int descriptor, i64 size, i64 start, Rows<i64> packets) {
    require(start >= 0, "packets begin before the file");
    Interrupt interrupt;
    Near near(known, descriptor, size);
    i64 count = 0, at = start;
    for (i64 walked = 0; at < size; ++walked) {
        if (walked % OFTEN == 0) interrupt.poll();
        if (size - at < HEADER) return {count, TORN, at};
        if (!near.reach(at, std::min(at + HEADER + SIZE, size))) return {count, CUT, at};
        i64 kind = near.word(at) & 0xFFFF, length = near.word(at + 4), when = near.word(at + 8);
        i64 overflow = near.word(at + 12), number = near.word(at + 20), valid = near.word(at + 24);
        bool counts = length > 0 && length < BITS_31 && number < BITS_31 && valid <= number && overflow < BITS_31;
        if (!counts || (kind == POLARITY_EVENT && (length != SIZE || when != 4))) return {count, NONSENSE, at};
        // the complete events of a truncated packet are kept, so the following bytes are within the file
        i64 first = at + HEADER, whole = std::min(number, (size - first) / length);
        if (kind == POLARITY_EVENT && whole) {
            if (count == packets.rows()) return {count, FULL, at};
            Packet packet{first, whole, overflow << 31, near.word(first + 4), 0, valid < whole};
            i64 last = first + SIZE * whole - 4;
            // the next packet's header follows, and is read together with it
            if (!near.reach(last, last + 4)) return {count, CUT, last};
            packet.first += packet.added;
            packet.last = packet.added + near.word(last);
            store(packet, packets[count++]);
        }
        at = first + whole * length;
        if (whole < number) return {count, TORN, at};
    }
    return {count, FINE, at};
}

namespace {

// Bounds of a valid event.
struct Bounds {
    u32 right, bottom;  // pixels
    u32 early, late;    // 31 bits of time
};

struct Event {
    u32 data, time;
    explicit Event(u64 word) : data(u32(word)), time(u32(word >> 32)) {}
    u32 x() const { return data >> 17; }
    u32 y() const { return data >> 2 & 0x7FFF; }
    u32 p() const { return data >> 1 & 1; }
    u32 marked() const { return data & 1; }
};

// Decode events as if all were valid; set `has_invalid` if one isn't.
NVSDATA_INLINE void decode_sound(Span<const u8> records, i64 added, Bounds bounds, Columns out, int* has_invalid) {
    int strange = 0;
    for (i64 i = 0; i < out.t.size(); ++i) {
        Event event(word_at<u64>(records, SIZE * i));
        strange |= int(event.x() >= bounds.right) | int(event.y() >= bounds.bottom) | int(event.marked() ^ 1);
        strange |= int(event.time < bounds.early) | int(event.time > bounds.late);
        out.t[i] = plus(added, event.time);
        out.x[i] = i16(event.x());
        out.y[i] = i16(event.y());
        out.p[i] = u8(event.p());
    }
    *has_invalid |= strange;
}

}  // namespace

std::tuple<i64, i64, i64, i64> aedat3_decode(Span<const u8> raw, i64 base, Rows<const i64> packets, i64 width,
                                             i64 height, i64 kept, Span<i64> t, Span<i16> x, Span<i16> y, Span<u8> p) {
    constexpr i64 FURTHEST = 1 << 15;  // beyond any pixel
    i64 begin = kept, unmarked = 0, bad = -1, strayed = -1;
    for (i64 k = 0; k < packets.rows(); ++k) {
        Packet packet = load<Packet>(packets[k]);
        i64 at = minus(packet.first_byte, base), number = packet.number;
        require(at >= 0 && at <= raw.size() && number >= 0 && number <= (raw.size() - at) / SIZE,
                "a packet lies outside of the bytes");
        Span<const u8> records = raw.part(at, at + SIZE * number);
        Columns out(t, x, y, p, kept, number);
        Bounds bounds{u32(std::clamp<i64>(width, 0, FURTHEST)), u32(std::clamp<i64>(height, 0, FURTHEST)), 0,
                      u32(BITS_31 - 1)};
        // a packet's first or last event may itself be an invalid one
        if (!packet.some_invalid) {
            bounds.early = u32(std::max<i64>(minus(minus(packet.first, packet.added), DISORDER_US), 0));
            bounds.late = u32(std::min(plus(minus(packet.last, packet.added), DISORDER_US), BITS_31 - 1));
        }
        int has_invalid = 0;
        best<decode_sound>(records, packet.added, bounds, out, &has_invalid);
        if (!has_invalid) {
            kept += number;
            continue;
        }
        i64 count = 0;
        for (i64 i = 0; i < number; ++i) {
            Event event(word_at<u64>(records, SIZE * i));
            if (packet.some_invalid && !event.marked()) continue;
            unmarked += !event.marked();
            bool outside = event.x() >= bounds.right || event.y() >= bounds.bottom;
            if (outside && bad < 0) bad = plus(packet.first_byte, SIZE * i);
            if ((event.time < bounds.early || event.time > bounds.late) && strayed < 0) strayed = k;
            out.t[count] = plus(packet.added, event.time);
            out.x[count] = i16(event.x());
            out.y[count] = i16(event.y());
            out.p[count++] = u8(event.p());
        }
        kept += count;
    }
    return {kept - begin, bad, unmarked, strayed};
}

void define_aedat3(nb::module_& module) {
    define<aedat3_packets>(module, "aedat3_packets");
    define<aedat3_decode>(module, "aedat3_decode");
}

}  // namespace nvsdata
