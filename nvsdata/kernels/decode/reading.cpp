// Small reads from open files.
#include "../native/bind.h"
#include "../native/files.h"
#include "../native/interrupt.h"

namespace nvsdata {

i64 read_samples(int handle, i64 begin, i64 step, Rows<u8> out) {
    Interrupt interrupt;
    for (i64 i = 0; i < out.rows(); ++i) {
        // a read may wait for the disk
        if (i % 64 == 63) interrupt.poll();
        // unsigned, because a step may lead far beyond the file
        if (!read_at(handle, i64(u64(begin) + u64(i) * u64(step)), out[i])) return i;
    }
    return out.rows();
}

void define_reading(nb::module_& module) { define<read_samples>(module, "read_samples"); }

}  // namespace nvsdata
