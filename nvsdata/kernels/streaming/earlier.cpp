// The nearest earlier events of each event.
#include "../native/bind.h"
#include "../native/interrupt.h"
#include "../native/require.h"
#include "window.h"

namespace nvsdata {

namespace {

// Fill `degree` with the number of sources of each event, and `source` with their ascending numbers; returns the sum.
i64 earlier_sources(Span<const i64> t, Span<const i32> x, Span<const i32> y, i64 width, i64 height, double radius,
                    double alpha, double beta, Span<i32> degree, Rows<i32> source) {
    i64 n = t.size(), count = 0;
    require(x.size() == n && y.size() == n && degree.size() == n && source.rows() == n && n <= streaming::MOST_EVENTS,
            "columns of events must be equally long");
    require(width > 0 && height > 0 && width <= streaming::MOST_PIXELS / height && source.columns() > 0,
            "no such sensor or number of neighbors");
    streaming::Metric metric(radius, alpha, beta, std::max(width, height) - 1);
    streaming::Window window(width, height, streaming::capacity_for(n), source.columns());
    Interrupt interrupt;
    for (i64 i = 0; i < n; ++i) {
        if (i % 256 == 0) interrupt.poll();
        require(window.is_inside(x[i], y[i]), "an event is outside the sensor");
        window.push(t[i], x[i], y[i]);
        window.search(i, metric);
        degree[i] = window.degree[i];
        for (i32 m = 0; m < degree[i]; ++m) source(i, m) = i32(window.source(i, m));
        std::sort(source[i].begin(), source[i].begin() + degree[i]);
        count += degree[i];
    }
    return count;
}

}  // namespace

void define_earlier(nb::module_& module) { define<earlier_sources>(module, "earlier_sources"); }

}  // namespace nvsdata
