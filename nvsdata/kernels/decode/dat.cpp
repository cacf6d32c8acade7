// Records of Prophesee .dat files; see columns.h for what a decoder returns.
#include "../native/bind.h"
#include "clocked.h"

namespace nvsdata {

namespace {

struct Dat1 {
    static u64 turned(u64 word) { return word; }
    static Place place(u32 address) {
        return {i32(address & 0x1FF), i32(address >> 9 & 0xFF), address >> 17 & 1, 0};
    }
};

struct Dat2 {
    static u64 turned(u64 word) { return word; }
    static Place place(u32 address) {
        return {i32(address & 0x3FFF), i32(address >> 14 & 0x3FFF), address >> 28, 0};
    }
};

}  // namespace

Found dat_decode(Span<const u8> raw, i64 block, i64 version, i64 width, i64 height, Span<i64> state, i64 kept,
                 Span<i64> t, Span<i16> x, Span<i16> y, Span<u8> p) {
    Columns out(t, x, y, p, kept, raw.size() / 8);
    return version >= 2 ? decode_clocked(Dat2(), raw, block, width, height, state, out)
                        : decode_clocked(Dat1(), raw, block, width, height, state, out);
}

void define_dat(nb::module_& module) { define<dat_decode>(module, "dat_decode"); }

}  // namespace nvsdata
