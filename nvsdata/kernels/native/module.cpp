// The compiled module: each source file defines its own functions, and one line here names its `define_...`.
#include <utility>

#include "bind.h"

#ifdef NVSDATA_BOUNDS
#define NVSDATA_CHECKS true
#else
#define NVSDATA_CHECKS false
#endif

namespace nvsdata {

void define_davis_stream(nb::module_& module);
void define_store(nb::module_& module);
void define_reading(nb::module_& module);
void define_aedat_frames(nb::module_& module);
void define_aedat4(nb::module_& module);
void define_aedat2(nb::module_& module);
void define_aedat3(nb::module_& module);
void define_atis(nb::module_& module);
void define_clock(nb::module_& module);
void define_dat(nb::module_& module);
void define_edges(nb::module_& module);
void define_neighbors(nb::module_& module);

}  // namespace nvsdata

NB_MODULE(_native, module) {
    // of a build that checks and counts every index: the elements touched by this thread's kernels since the last call
    module.attr("checks_bounds") = NVSDATA_CHECKS;
#ifdef NVSDATA_BOUNDS
    module.def("touched", [] { return std::exchange(nvsdata::touched, 0); });
#endif
    nvsdata::define_davis_stream(module);
    nvsdata::define_store(module);
    nvsdata::define_reading(module);
    nvsdata::define_aedat_frames(module);
    nvsdata::define_aedat4(module);
    nvsdata::define_aedat2(module);
    nvsdata::define_aedat3(module);
    nvsdata::define_atis(module);
    nvsdata::define_clock(module);
    nvsdata::define_dat(module);
    nvsdata::define_edges(module);
    nvsdata::define_neighbors(module);
}
