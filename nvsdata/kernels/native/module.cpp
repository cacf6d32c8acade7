// The compiled module: each source file defines its own functions.
#include "bind.h"

namespace nvsdata {

void define_edges(nb::module_& module);
void define_neighbors(nb::module_& module);

}  // namespace nvsdata

NB_MODULE(_native, module) {
    nvsdata::define_edges(module);
    nvsdata::define_neighbors(module);
}
