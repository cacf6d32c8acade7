// Records of AEDAT 2 files, big-endian; see columns.h for what a decoder returns.
#include "../native/bind.h"
#include "../native/interrupt.h"
#include "clocked.h"
#include "events.h"

namespace nvsdata {

namespace {

constexpr i64 DVS128 = 0;       // layout of addresses; all others are those of a DAVIS
constexpr i64 OFTEN = 1 << 14;  // records between two polls for Ctrl-C

u64 swapped(u64 word) {
    word = (word & 0x00FF00FF00FF00FF) << 8 | (word >> 8 & 0x00FF00FF00FF00FF);
    word = (word & 0x0000FFFF0000FFFF) << 16 | (word >> 16 & 0x0000FFFF0000FFFF);
    return word << 32 | word >> 32;
}

// x and y are mirrored within the chip, whose last pixel is (`right`, `bottom`).
struct Dvs128 {
    i32 right, bottom;
    static u64 turned(u64 word) { return swapped(word); }
    Place place(u32 address) const {
        return {right - i32(address >> 1 & 0x7F), bottom - i32(address >> 8 & 0x7F), ~address & 1,
                address & 0x80008000};
    }
    u32 address(u32 column, u32 row, u32 on) const { return row << 8 | column << 1 | (1 - on); }
};

struct Davis {
    i32 right, bottom;
    static u64 turned(u64 word) { return swapped(word); }
    Place place(u32 address) const {
        return {right - i32(address >> 12 & 0x3FF), bottom - i32(address >> 22 & 0x1FF), address >> 11 & 1,
                address & 0x80000400};
    }
    u32 address(u32 column, u32 row, u32 on) const { return row << 22 | column << 12 | on << 11; }
};

template <class Layout>
Layout layout_of(i64 chip_width, i64 chip_height) {
    require(std::min(chip_width, chip_height) >= 1 && std::max(chip_width, chip_height) <= 1 << 15,
            "a chip has 1 to 32768 pixels along each side");
    return {i32(chip_width - 1), i32(chip_height - 1)};
}

// Records of some events, in the order in which a file has their bytes.
template <class Layout>
NVSDATA_INLINE void encode(Layout layout, Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p,
                           Span<u64> records) {
    for (i64 i = 0; i < records.size(); ++i) {
        u32 column = u32(layout.right - x[i]), row = u32(layout.bottom - y[i]);
        records[i] = swapped(u64(layout.address(column, row, p[i])) << 32 | u32(t[i]));
    }
}

template <class Layout>
void encode_all(const Layout& layout, Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p,
                Span<u64> records) {
    Interrupt interrupt;
    for (i64 from = 0; from < t.size(); from += OFTEN) {
        i64 to = std::min(from + OFTEN, t.size());
        best<encode<Layout>>(layout, t.part(from, to), x.part(from, to), y.part(from, to), p.part(from, to),
                             records.part(from, to));
        interrupt.poll();
    }
}

}  // namespace

Found aedat2_decode(Span<const u8> raw, i64 block, i64 layout, i64 chip_width, i64 chip_height, i64 width, i64 height,
                    Span<i64> state, i64 kept, Span<i64> t, Span<i16> x, Span<i16> y, Span<u8> p) {
    Columns out(t, x, y, p, kept, raw.size() / 8);
    if (layout == DVS128)
        return decode_clocked(layout_of<Dvs128>(chip_width, chip_height), raw, block, width, height, state, out);
    return decode_clocked(layout_of<Davis>(chip_width, chip_height), raw, block, width, height, state, out);
}

void aedat2_encode(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 layout,
                   i64 chip_width, i64 chip_height, Span<u64> records) {
    require(Events(t, x, y, p).size() == records.size(), "there must be a record for each event");
    if (layout == DVS128)
        encode_all(layout_of<Dvs128>(chip_width, chip_height), t, x, y, p, records);
    else
        encode_all(layout_of<Davis>(chip_width, chip_height), t, x, y, p, records);
}

void define_aedat2(nb::module_& module) {
    define<aedat2_decode>(module, "aedat2_decode");
    define<aedat2_encode>(module, "aedat2_encode");
}

}  // namespace nvsdata
