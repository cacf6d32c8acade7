// Frames among AEDAT 2 records, assembled pixel by pixel.
#include <algorithm>
#include <utility>

#include "../native/bind.h"
#include "columns.h"

namespace nvsdata {

namespace {

// The facts of a frame, an int64 array in Python, which reads the first eight.
struct FrameFacts {
    i64 start, exposure_start, exposure_end, end;
    i64 left, top, right, bottom;
    i64 before, after;  // numbers of readings of both kinds
    i64 column;         // column that was read last
    i64 way;            // direction of columns, 1 or -1, 0 if not known yet
};

static_assert(sizeof(FrameFacts) == 12 * sizeof(i64), "as many as in Python's array");

class FrameReader {
public:
    FrameReader(Rows<u16> before, Rows<u16> light, Rows<u8> state, Span<const i64> facts)
        : before_(before), light_(light), state_(state), facts_(load<FrameFacts>(facts)) {
        for (Rows<u16> rows : {before, light})
            require(rows.rows() == state.rows() && rows.columns() == state.columns(), "arrays of different sensors");
    }
    const FrameFacts& facts() const { return facts_; }

    // Whether a frame ended before the record. If not, the record is processed.
    bool take(i64 address, i64 t) {
        i64 x = address >> 12 & 0x3FF, y = state_.rows() - 1 - (address >> 22 & 0x1FF);
        if (x >= state_.columns() || y < 0) return false;
        u16 value = address & 0x3FF;
        if (address >> 10 & 3)
            take_after(x, y, value, t);
        else if (begins_another(x, y))
            return true;
        else
            take_before(x, y, value, t);
        return false;
    }

    // Whether the frame so far is complete; if so, `state` and the counts are reset for the next frame.
    bool ended() {
        // unsigned, because values from Python have no bounds
        u64 area = (u64(facts_.right) + 1 - u64(facts_.left)) * (u64(facts_.bottom) + 1 - u64(facts_.top));
        bool whole = facts_.before > 0 && u64(facts_.before) == area && u64(facts_.after) == area;
        if (whole) {
            clear_state();
            facts_.before = facts_.after = 0;
        }
        return whole;
    }

private:
    Rows<u16> before_, light_;
    Rows<u8> state_;  // of each pixel: 0, 1 after its first reading, 2 after its second one
    FrameFacts facts_;

    void clear_state() { std::fill(state_.flat().begin(), state_.flat().end(), u8(0)); }

    void take_after(i64 x, i64 y, u16 value, i64 t) {
        if (state_(y, x) != 1) return;
        state_(y, x) = 2;
        light_(y, x) = before_(y, x) > value ? before_(y, x) - value : 0;
        if (facts_.after == 0) facts_.exposure_end = t;
        facts_.end = t;
        ++facts_.after;
    }

    // Whether a reading before an exposure belongs to the next frame, and this one is complete.
    bool begins_another(i64 x, i64 y) {
        i64 step = i64(u64(x) - u64(facts_.column));
        if ((step == 1 || step == -1) && facts_.way == 0 && facts_.before) facts_.way = step;
        if (!state_(y, x) && !(facts_.before && step != 0 && step != facts_.way)) return false;
        // the caller calls again from here, with an empty frame
        if (ended()) return true;
        clear_state();
        i64 column = facts_.column, way = facts_.way;
        facts_ = {};
        facts_.column = column, facts_.way = way;
        return false;
    }

    void take_before(i64 x, i64 y, u16 value, i64 t) {
        facts_.column = x;
        if (facts_.before == 0) {
            facts_.start = t;
            facts_.left = facts_.right = x;
            facts_.top = facts_.bottom = y;
        }
        // a rolling shutter reads some pixels a second time before it has read all pixels once
        facts_.exposure_start = facts_.after == 0 ? t : facts_.start;
        facts_.left = std::min(facts_.left, x);
        facts_.right = std::max(facts_.right, x);
        facts_.top = std::min(facts_.top, y);
        facts_.bottom = std::max(facts_.bottom, y);
        ++facts_.before;
        state_(y, x) = 1;
        before_(y, x) = value;
    }
};

}  // namespace

std::pair<i64, bool> next_frame(Span<const u32> addresses, Span<const i64> t, i64 at, Rows<u16> before,
                                Rows<u16> light, Rows<u8> state, Span<i64> facts) {
    require(t.size() == addresses.size() && u64(at) <= u64(t.size()), "a record is an address and a time");
    FrameReader reader(before, light, state, facts);
    bool found = addresses.empty() && reader.ended();
    while (at < addresses.size() && !(found = reader.take(addresses[at], t[at]))) ++at;
    store(reader.facts(), facts);
    return {at, found};
}

void define_aedat_frames(nb::module_& module) { define<next_frame>(module, "next_frame"); }

}  // namespace nvsdata
