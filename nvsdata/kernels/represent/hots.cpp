// Layers of HOTS (Lagorce et al. 2017): time surfaces of features around events, and the prototypes nearest to them.
//
// A value of a surface is stored as exp((t - t_0) / tau), so that its value at a later time is a product.
#include <cmath>
#include <limits>
#include <vector>

#include "../native/bind.h"
#include "../native/levels.h"
#include "events.h"

namespace nvsdata {

namespace {

constexpr i64 LANES = 16;  // partial sums, the same number on every processor

NVSDATA_INLINE float product(const float* a, const float* b, i64 count) {
    float sums[LANES] = {};
    i64 i = 0;
    for (; i + LANES <= count; i += LANES)
        for (i64 k = 0; k < LANES; ++k) sums[k] += a[i + k] * b[i + k];
    for (; i < count; ++i) sums[i % LANES] += a[i] * b[i];
    float total = 0;
    for (float sum : sums) total += sum;
    return total;
}

// Calls each(i, value, corner) for each event i after its value was added to `grown`; its surface begins at `corner`.
template <class Each>
void each_surface(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const i64> feature, double tau,
                  i64 radius, Array<double, 3> grown, Each each) {
    auto [features, rows, stride] = grown.shape;
    require_columns(t.size(), {x, y});
    require_margin(radius, rows, stride);
    require(feature.size() == t.size(), "events must each have a feature");
    i64 size = rows * stride, middle = radius * stride + radius;
    u64 count = u64(features);
    each_event({stride - 2 * radius, rows - 2 * radius, stride, size}, {x, y}, [&](i64 i, i64 place) {
        if (u64(feature[i]) >= count) throw std::out_of_range("a feature doesn't exist");
        double value = std::exp(double(minus(t[i], t[0])) / tau);
        grown.values[feature[i] * size + place + middle] = value;
        each(i, value, place);
    });
}

void feature_surfaces(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const i64> feature, double tau,
                      i64 radius, Span<const i64> wanted, Array<double, 3> grown, Array<float, 4> out) {
    auto [features, rows, stride] = grown.shape;
    i64 side = 2 * radius + 1, size = rows * stride, columns = stride, channels = features, m = 0;
    require_shapes(out.shape == std::array<i64, 4>{wanted.size(), features, side, side});
    each_surface(t, x, y, feature, tau, radius, grown, [&](i64 i, double value, i64 corner) {
        if (m == wanted.size() || wanted[m] != i) return;
        float* surface = out.values.data() + m++ * channels * side * side;
        for (i64 f = 0; f < channels; ++f)
            for (i64 r = 0; r < side; ++r)
                for (i64 c = 0; c < side; ++c)
                    *surface++ = float(grown.values[f * size + corner + r * columns + c] / value);
    });
}

void nearest_prototypes(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const i64> feature, double tau,
                        i64 radius, Array<const float, 4> prototypes, Array<double, 3> grown, Span<i64> found) {
    auto [features, rows, stride] = grown.shape;
    i64 side = 2 * radius + 1, size = rows * stride, columns = stride, channels = features;
    i64 count = prototypes.shape[0], length = channels * side * side;
    require_shapes(prototypes.shape == std::array<i64, 4>{count, features, side, side} && found.size() == t.size());
    std::vector<float> squares(static_cast<std::size_t>(count)), surface(static_cast<std::size_t>(length));
    for (i64 k = 0; k < count; ++k)
        for (float value : prototypes.values.part(k * length, (k + 1) * length)) squares[k] += value * value;
    each_surface(t, x, y, feature, tau, radius, grown, [&](i64 i, double value, i64 corner) {
        double shrink = 1 / value, least = std::numeric_limits<double>::infinity();
        float* flat = surface.data();
        for (i64 f = 0; f < channels; ++f)
            for (i64 r = 0; r < side; ++r)
                for (i64 c = 0; c < side; ++c)
                    *flat++ = float(grown.values[f * size + corner + r * columns + c] * shrink);
        for (i64 k = 0; k < count; ++k) {
            // the squared norm of the surface is the same for all prototypes
            float product_k = best<product>(&prototypes.values[k * length], surface.data(), length);
            double distance = squares[k] - 2 * double(product_k);
            if (distance < least) least = distance, found[i] = k;
        }
    });
}

}  // namespace

void define_hots(nb::module_& module) {
    define<feature_surfaces>(module, "feature_surfaces");
    define<nearest_prototypes>(module, "nearest_prototypes");
}

}  // namespace nvsdata
