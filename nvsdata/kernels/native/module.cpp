// The compiled module: each source file defines its own functions, and one line here names its `define_...`.
#include <utility>

#include "bind.h"

#ifdef NVSDATA_BOUNDS
#define NVSDATA_CHECKS true
#else
#define NVSDATA_CHECKS false
#endif

namespace nvsdata {

void define_decoder_errors(nb::module_& module);
void define_aedat2(nb::module_& module);
void define_aedat3(nb::module_& module);
void define_davis_stream(nb::module_& module);
void define_store(nb::module_& module);
void define_reading(nb::module_& module);
void define_aedat_frames(nb::module_& module);
void define_aedat4(nb::module_& module);
void define_atis(nb::module_& module);
void define_clock(nb::module_& module);
void define_dat(nb::module_& module);
void define_distances(nb::module_& module);
void define_earth_mover(nb::module_& module);
void define_edges(nb::module_& module);
void define_evt(nb::module_& module);
void define_evt2(nb::module_& module);
void define_evt3(nb::module_& module);
void define_brightness(nb::module_& module);
void define_crossings(nb::module_& module);
void define_edges(nb::module_& module);
void define_photoreceptor(nb::module_& module);
void define_pix2nvs(nb::module_& module);
void define_spikes(nb::module_& module);
void define_tiles(nb::module_& module);
void define_neighbors(nb::module_& module);
void define_order(nb::module_& module);
void define_select(nb::module_& module);
void define_text(nb::module_& module);
void define_causal(nb::module_& module);
void define_earlier(nb::module_& module);
void define_sliding(nb::module_& module);
void define_streaming_network(nb::module_& module);
void define_pool(nb::module_& module);
void define_spline(nb::module_& module);
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
    nvsdata::define_decoder_errors(module);
    nvsdata::define_aedat2(module);
    nvsdata::define_aedat3(module);
    nvsdata::define_davis_stream(module);
    nvsdata::define_store(module);
    nvsdata::define_reading(module);
    nvsdata::define_aedat_frames(module);
    nvsdata::define_aedat4(module);
    nvsdata::define_atis(module);
    nvsdata::define_clock(module);
    nvsdata::define_dat(module);
    nvsdata::define_distances(module);
    nvsdata::define_earth_mover(module);
    nvsdata::define_edges(module);
    nvsdata::define_evt(module);
    nvsdata::define_evt2(module);
    nvsdata::define_evt3(module);
    nvsdata::define_brightness(module);
    nvsdata::define_crossings(module);
    nvsdata::define_edges(module);
    nvsdata::define_photoreceptor(module);
    nvsdata::define_pix2nvs(module);
    nvsdata::define_spikes(module);
    nvsdata::define_tiles(module);
    nvsdata::define_neighbors(module);
    nvsdata::define_order(module);
    nvsdata::define_select(module);
    nvsdata::define_text(module);
    nvsdata::define_causal(module);
    nvsdata::define_earlier(module);
    nvsdata::define_sliding(module);
    nvsdata::define_streaming_network(module);
    nvsdata::define_pool(module);
    nvsdata::define_spline(module);
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
