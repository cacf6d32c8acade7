// The compiled module: each source file defines its own functions, by a `define_NAME` whose name has a line here.
#include <utility>

#include "bind.h"

#ifdef NVSDATA_BOUNDS
#define NVSDATA_CHECKS true
#else
#define NVSDATA_CHECKS false
#endif

#define NVSDATA_FILES(define) \
    define(aedat2) \
    define(aedat3) \
    define(aedat4) \
    define(aedat_frames) \
    define(atis) \
    define(blocks) \
    define(brightness) \
    define(causal) \
    define(clock) \
    define(corners) \
    define(crossings) \
    define(dat) \
    define(davis_stream) \
    define(decoder_errors) \
    define(distances) \
    define(earlier) \
    define(earth_mover) \
    define(ecf) \
    define(edge_code) \
    define(edges) \
    define(evt) \
    define(evt2) \
    define(evt3) \
    define(filters) \
    define(flow) \
    define(frames) \
    define(hats) \
    define(hfirst) \
    define(hots) \
    define(inside) \
    define(latest) \
    define(learned) \
    define(log_polar) \
    define(lzf) \
    define(measures) \
    define(moves) \
    define(names) \
    define(neighbors) \
    define(order) \
    define(patches) \
    define(photoreceptor) \
    define(pix2nvs) \
    define(pool) \
    define(reading) \
    define(sample) \
    define(select) \
    define(sliding) \
    define(spikes) \
    define(spline) \
    define(store) \
    define(streaming_network) \
    define(surfaces) \
    define(text) \
    define(tiles)

namespace nvsdata {

#define NVSDATA_DECLARE(name) void define_##name(nb::module_& module);
NVSDATA_FILES(NVSDATA_DECLARE)

}  // namespace nvsdata

NB_MODULE(_native, module) {
    // of a build that checks and counts every index: the elements touched by this thread's kernels since the last call
    module.attr("checks_bounds") = NVSDATA_CHECKS;
#ifdef NVSDATA_BOUNDS
    module.def("touched", [] { return std::exchange(nvsdata::touched, 0); });
#endif
#define NVSDATA_DEFINE(name) nvsdata::define_##name(module);
    NVSDATA_FILES(NVSDATA_DEFINE)
}
