// The compiled module: each source file defines its own functions, and one line here names its `define_...`.
#include <utility>

#include "bind.h"

#ifdef NVSDATA_BOUNDS
#define NVSDATA_CHECKS true
#else
#define NVSDATA_CHECKS false
#endif

namespace nvsdata {

void define_distances(nb::module_& module);
void define_earth_mover(nb::module_& module);
void define_edges(nb::module_& module);
void define_neighbors(nb::module_& module);
void define_pool(nb::module_& module);
void define_spline(nb::module_& module);

}  // namespace nvsdata

NB_MODULE(_native, module) {
    // of a build that checks and counts every index: the elements touched by this thread's kernels since the last call
    module.attr("checks_bounds") = NVSDATA_CHECKS;
#ifdef NVSDATA_BOUNDS
    module.def("touched", [] { return std::exchange(nvsdata::touched, 0); });
#endif
    nvsdata::define_distances(module);
    nvsdata::define_earth_mover(module);
    nvsdata::define_edges(module);
    nvsdata::define_neighbors(module);
    nvsdata::define_pool(module);
    nvsdata::define_spline(module);
}
