// LZF, h5py's own compression of HDF5 chunks. A byte below 32 begins a run: that many bytes and one more are copied. Any
// other begins a match, which repeats earlier output: its upper three bits are the length less 2 (7: the next byte is
// added), and the lower five, with another byte, the distance less 1.
#include <algorithm>

#include "../native/bind.h"
#include "../native/interrupt.h"

namespace nvsdata {

namespace {

constexpr i64 OFTEN = 1 << 20;  // bytes between two polls for Ctrl-C

// Return the number of bytes of the expansion, all those of `out` if it doesn't fit; -1 if the data is damaged.
i64 expand_lzf(Span<const u8> data, Span<u8> out) {
    Interrupt interrupt;
    i64 in = 0, done = 0, next_poll = OFTEN;
    while (in < data.size()) {
        if (done >= next_poll) {
            interrupt.poll();
            next_poll += OFTEN;
        }
        i64 code = data[in++];
        if (code < 32) {
            i64 count = code + 1;
            if (count > data.size() - in) return -1;
            if (count > out.size() - done) return out.size();
            std::copy_n(data.begin() + in, count, out.begin() + done);
            in += count;
            done += count;
            continue;
        }
        i64 length = (code >> 5) + 2;
        if (length == 9 && in < data.size()) length += data[in++];
        if (in >= data.size()) return -1;
        i64 distance = ((code & 31) << 8 | data[in++]) + 1;
        if (distance > done) return -1;
        if (length > out.size() - done) return out.size();
        // byte by byte, because a match may repeat what it has just written
        for (i64 end = done + length; done < end; ++done) out[done] = out[done - distance];
    }
    return done;
}

}  // namespace

void define_lzf(nb::module_& module) { define<expand_lzf>(module, "expand_lzf"); }

}  // namespace nvsdata
