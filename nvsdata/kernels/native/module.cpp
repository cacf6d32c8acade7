// The compiled module: each source file defines its own functions, and one line here names its `define_...`.
#include <utility>

#include "bind.h"

#ifdef NVSDATA_BOUNDS
#define NVSDATA_CHECKS true
#else
#define NVSDATA_CHECKS false
#endif

namespace nvsdata {

void define_brightness(nb::module_& module);
void define_crossings(nb::module_& module);
void define_edges(nb::module_& module);
void define_photoreceptor(nb::module_& module);
void define_pix2nvs(nb::module_& module);
void define_spikes(nb::module_& module);
void define_tiles(nb::module_& module);
void define_neighbors(nb::module_& module);

}  // namespace nvsdata

NB_MODULE(_native, module) {
    // of a build that checks and counts every index: the elements touched by this thread's kernels since the last call
    module.attr("checks_bounds") = NVSDATA_CHECKS;
#ifdef NVSDATA_BOUNDS
    module.def("touched", [] { return std::exchange(nvsdata::touched, 0); });
#endif
    nvsdata::define_brightness(module);
    nvsdata::define_crossings(module);
    nvsdata::define_edges(module);
    nvsdata::define_photoreceptor(module);
    nvsdata::define_pix2nvs(module);
    nvsdata::define_spikes(module);
    nvsdata::define_tiles(module);
    nvsdata::define_neighbors(module);
}
