// The compiled module: each source file defines its own functions, and one line here names its `define_...`.
#include <utility>

#include "bind.h"

#ifdef NVSDATA_BOUNDS
#define NVSDATA_CHECKS true
#else
#define NVSDATA_CHECKS false
#endif

namespace nvsdata {

void define_edges(nb::module_& module);
void define_filters(nb::module_& module);
void define_frames(nb::module_& module);
void define_hats(nb::module_& module);
void define_hots(nb::module_& module);
void define_inside(nb::module_& module);
void define_latest(nb::module_& module);
void define_learned(nb::module_& module);
void define_log_polar(nb::module_& module);
void define_measures(nb::module_& module);
void define_neighbors(nb::module_& module);
void define_patches(nb::module_& module);
void define_sample(nb::module_& module);
void define_surfaces(nb::module_& module);

}  // namespace nvsdata

NB_MODULE(_native, module) {
    // of a build that checks and counts every index: the elements touched by this thread's kernels since the last call
    module.attr("checks_bounds") = NVSDATA_CHECKS;
#ifdef NVSDATA_BOUNDS
    module.def("touched", [] { return std::exchange(nvsdata::touched, 0); });
#endif
    nvsdata::define_edges(module);
    nvsdata::define_filters(module);
    nvsdata::define_frames(module);
    nvsdata::define_hats(module);
    nvsdata::define_hots(module);
    nvsdata::define_inside(module);
    nvsdata::define_latest(module);
    nvsdata::define_learned(module);
    nvsdata::define_log_polar(module);
    nvsdata::define_measures(module);
    nvsdata::define_neighbors(module);
    nvsdata::define_patches(module);
    nvsdata::define_sample(module);
    nvsdata::define_surfaces(module);
}
