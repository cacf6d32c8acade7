// B-spline convolutions of changing graphs: only rows whose inputs changed are computed, from the changes.
//
// The sum over the edges of a node is kept in float64, so that terms can be subtracted. If few edges of a target
// changed, their differences are added; otherwise the target is summed from scratch. Zeros, which ReLU makes frequent,
// aren't multiplied.
#pragma once

#include <memory>

#include "../native/interrupt.h"
#include "cells.h"
#include "window.h"

namespace nvsdata::streaming {

constexpr i64 TOGETHER = 16;  // targets that are multiplied with each weight while it is in the cache
constexpr i64 OLD = 500;      // differences after which a sum is computed from scratch, so that rounding doesn't add up

// Weights of a convolution with folded normalization.
struct Kernel {
    i64 size;                           // cells along an axis
    bool loops, own, is_signed;         // self-loops; own features; signed pseudo-coordinates
    std::vector<float> reach;           // normalization range of each axis
    i64 cells, in, out;                 // cells of all axes; numbers of input and output channels
    Table<float> weight;                // rows of each cell, then of the node itself: one row per input channel
    std::vector<float> bias;
};

// Features of nodes, and those `before` this step for nodes that `changed`.
struct Features {
    Table<float> values, before;
    Marks changed;
    Features(i64 nodes, i64 channels) : values(nodes, channels), before(nodes, channels), changed(nodes) {}
};

// Sums over the edges of up to TOGETHER targets, and their products with the weights.
class Convolution {
public:
    i64 products = 0;  // multiplications so far

    explicit Convolution(std::shared_ptr<const Kernel> kernel)
        : kernel_(std::move(kernel)), share_(TOGETHER * (kernel_->cells + 1), kernel_->in),
          used_(TOGETHER, kernel_->cells + 1), product_(TOGETHER, 2 * kernel_->out) {}

    const Kernel& kernel() const { return *kernel_; }

    // Add the features of a source, minus `less` unless that is empty, to the kernel cells of an edge. The shares of
    // the cells are B-splines of degree 1. With `way` -1 the features are subtracted.
    void add(i64 at, Span<const float> features, Span<const float> less, const Place& away, float way);

    // Add the features of the node itself in the same way.
    void add_self(i64 at, Span<const float> features, Span<const float> less) {
        if (kernel_->loops) add(at, features, less, {}, 1);
        if (kernel_->own) add_to(at, kernel_->cells, features, less, 1);
    }

    // Multiply the sums of the first targets by the weights, and set them to 0.
    void multiply(i64 targets);

    // Add the products of a target to its sums, and set them to 0. Write its output: the mean over its edges plus the
    // product of the node itself.
    void collect(i64 at, i64 degree, Span<double> edges, Span<double> self, Span<float> out);

private:
    std::shared_ptr<const Kernel> kernel_;
    Table<float> share_;    // sums of features, by target and cell of the kernel
    Table<u8> used_;        // which of these sums are in use
    Table<float> product_;  // products of these sums and the weights: over the edges, and of the node itself

    void add_to(i64 at, i64 cell, Span<const float> features, Span<const float> less, float part);
};

// A convolution of events. Each row is computed from scratch, because events have few features.
void convolve(Convolution& layer, const Window& window, const Table<float>& features, Span<const i64> rows,
              Table<float>& out, Interrupt& interrupt);

// A convolution of a pooled graph.
class CellLayer {
public:
    Table<float> out;
    std::vector<i64> rows;  // rows of `out` that the last update computed

    CellLayer(std::shared_ptr<const Kernel> kernel, i64 nodes)
        : out(nodes, kernel->out), convolution_(std::move(kernel)), edges_(nodes, out.columns()), self_(edges_),
          age_(nodes), dirty_(nodes) {}

    // Compute the rows whose inputs changed.
    void update(const Cells& cells, Features& features, Interrupt& interrupt);

    i64 products() const { return convolution_.products; }

private:
    Convolution convolution_;
    Table<double> edges_, self_;  // sums over the edges, and for the node itself
    Column<i64> age_;             // number of additions to these sums
    Marks dirty_;

    void mark_targets(const Cells& cells, const Features& features);
    i64 sum_up(const Cells& cells, const Features& features, i64 at, i64 cell);
};

}  // namespace nvsdata::streaming
