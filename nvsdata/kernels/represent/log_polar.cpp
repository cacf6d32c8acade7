// Counts of recent events around each event, by distance and direction.
#include <vector>

#include "../native/bind.h"
#include "events.h"

namespace nvsdata {

namespace {

void around_events(Span<const i16> x, Span<const i16> y, i64 queue, Span<const i64> dx, Span<const i64> dy,
                   Rows<const float> weights, Rows<i32> count, Rows<float> out) {
    i64 n = x.size(), offsets = dx.size(), bins = weights.columns(), margin = 0;
    require(queue >= 1, "the queue must have a place");
    require_shapes(y.size() == n && dy.size() == offsets && weights.rows() == offsets && out.rows() == n &&
                   out.columns() == bins);
    for (i64 m = 0; m < offsets; ++m)
        for (i64 d : {dx[m], dy[m]}) {
            require(d >= -32768 && d <= 32768, "offsets must lie on a sensor");
            margin = std::max(margin, std::abs(d));
        }
    i64 rows = count.rows(), stride = count.columns();
    require_margin(margin, rows, stride);
    // for each offset: the step to its pixel, and the bins that it reaches, one after the other
    std::vector<i64> steps, begins, which;
    std::vector<float> fractions;
    for (i64 m = 0; m < offsets; ++m) {
        steps.push_back(dy[m] * stride + dx[m]);
        begins.push_back(i64(which.size()));
        for (i64 b = 0; b < bins; ++b)
            if (weights(m, b) != 0) which.push_back(b), fractions.push_back(weights(m, b));
    }
    begins.push_back(i64(which.size()));
    Span<const i64> step_to(steps), begin_of(begins), bin_of(which);
    Span<const float> fraction_of(fractions);
    Span<i32> counts = count.flat();
    Images images{stride - 2 * margin, rows - 2 * margin, stride, rows * stride};
    i64 middle = margin * stride + margin;
    each_event(images, {x, y}, [&](i64 i, i64 place) {
        ++counts[place + middle];
        // the pixels of earlier events have been checked
        if (i >= queue) --counts[y[i - queue] * stride + x[i - queue] + middle];
        double total = 0;
        Span<float> row = out[i];
        for (i64 m = 0; m < offsets; ++m) {
            i32 near = counts[place + middle + step_to[m]];
            if (near == 0) continue;
            for (i64 k = begin_of[m]; k < begin_of[m + 1]; ++k) {
                double value = double(near) * double(fraction_of[k]);
                row[bin_of[k]] = float(double(row[bin_of[k]]) + value);
                total += value;
            }
        }
        for (float& value : row) value = float(double(value) / total);
    });
}

}  // namespace

void define_log_polar(nb::module_& module) { define<around_events>(module, "around_events"); }

}  // namespace nvsdata
