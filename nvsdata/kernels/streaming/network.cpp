// Weights of a network for incremental inference.
#include "network.h"

#include "../native/bind.h"
#include "../native/levels.h"
#include "../native/require.h"

namespace nvsdata {

namespace streaming {

namespace {

NVSDATA_INLINE void add_row(double* __restrict sum, const float* weight, double factor, i64 size) {
    for (i64 o = 0; o < size; ++o) sum[o] += factor * weight[o];
}

Network network(i64 width, i64 height, double radius, double alpha, double beta, i64 k) {
    require(width > 0 && height > 0 && width <= MOST_PIXELS / height, "no such sensor");
    require(k > 0 && k < INT32_MAX, "no such number of neighbors");
    auto metric = std::make_shared<const Metric>(radius, alpha, beta, std::max(width, height) - 1);
    return {width, height, k, metric, {}, nullptr};
}

void add_layer(Network& network, Rows<const float> weight, Span<const float> bias, Span<const float> reach, i64 size,
               bool loops, bool own, bool is_signed, i64 cluster_width, i64 cluster_height, bool is_average) {
    i64 axes = reach.size(), cells = 1, in = network.layers.empty() ? 1 : network.last().kernel->out;
    require(size > 0 && size < 1000 && (axes == 2 || axes == 3), "no such kernel");
    for (i64 axis = 0; axis < axes; ++axis) cells *= size;
    require(weight.rows() == (cells + 1) * in && weight.columns() > 0 && bias.size() == weight.columns(),
            "weights don't fit the kernel");
    for (float end : reach) require(end > 0, "an axis of the pseudo-coordinates must not end at 0");
    // 0 pixels: not pooled
    bool is_pooled = cluster_width || cluster_height;
    require(!is_pooled || (cluster_width > 0 && cluster_height > 0), "no such clusters");
    std::vector<float> ends(reach.begin(), reach.end()), biases(bias.begin(), bias.end());
    Kernel kernel{size, loops, own, is_signed, ends, cells, in, weight.columns(), Table<float>(weight), biases};
    Grid grid{};
    if (is_pooled) grid = Grid::of(network.width, network.height, cluster_width, cluster_height);
    network.layers.push_back({std::make_shared<const Kernel>(std::move(kernel)), is_pooled, is_average, grid});
}

void set_hidden(Network& network, Rows<const float> weight) {
    require(!network.layers.empty(), "a network without layers");
    require(weight.columns() == 0 || weight.rows() == network.grid().size() * network.last().kernel->out,
            "weights don't fit the last layer");
    network.hidden = std::make_shared<const Table<float>>(weight);
}

}  // namespace

void Readout::show(i64 cell, Span<const float> values) {
    Span<float> row = shown[cell];
    i64 units = weight_->columns();
    for (i64 c = 0; c < values.size(); ++c) {
        double difference = double(values[c]) - row[c];
        if (difference == 0) continue;
        row[c] = values[c];
        if (units) best<add_row>(sum.data(), (*weight_)[cell * row.size() + c].data(), difference, units);
        products += units;
    }
}

}  // namespace streaming

void define_streaming_network(nb::module_& module) {
    streaming::refuse_copies(nb::class_<streaming::Network>(module, "StreamingNetwork"));
    define<streaming::network>(module, "streaming_network");
    define<streaming::add_layer>(module, "add_streaming_layer");
    define<streaming::set_hidden>(module, "set_streaming_hidden");
}

}  // namespace nvsdata
