// A network's rows for the events in a sliding window.
#include "sliding.h"

#include "../native/bind.h"
#include "network.h"

namespace nvsdata {

namespace streaming {

namespace {

class SlidingNetwork {
public:
    explicit SlidingNetwork(const Network& network)
        : network_(network), graph_(graph_of(network)), polarity_(graph_.window.capacity(), 1),
          events_(network.layers[0].kernel), out_(graph_.window.capacity(), network.layers[0].kernel->out),
          readout_(network.readout()) {
        for (const Network::Layer& layer : network.layers) {
            bool is_first = &layer == &network.layers[0];
            if (!is_first) layers_.emplace_back(layer.kernel, graph().grid.size());
            if (layer.is_pooled && !is_first) pooled_.push_back(graph().pooled(layer.grid));
            poolings_.emplace_back(layer.is_average, layer.kernel->out);
            features_.emplace_back(graph().grid.size(), layer.kernel->out);
        }
    }

    void step(i64 until, const Events& events) {
        auto turn = turns_.take();
        events.check(network_, last_);
        turns_.begin_change();
        Interrupt interrupt;
        if (events.size() && count_before(until) == size()) {
            // the origin of times is moved if possible, so that sums of times stay small
            advance(until, {}, interrupt);
            origin_ = events.t[0];
        }
        advance(until, events, interrupt);
        turns_.end_change();
    }

    i64 size() const { return window().size(); }
    i64 origin() const { return origin_; }
    const Window& window() const { return graph_.window; }
    const Table<float>& polarity() const { return polarity_; }
    const Readout& readout() const { return readout_; }
    i64 products() const {
        i64 sum = events_.products + readout_.products;
        for (const CellLayer& layer : layers_) sum += layer.products();
        return sum;
    }
    // Number of events before a time.
    i64 count_before(i64 until) const {
        i64 first = window().first, end = window().next;
        while (first < end) {
            i64 middle = first + (end - first) / 2;
            if (window().t[window().row_of(middle)] + origin_ < until)
                first = middle + 1;
            else
                end = middle;
        }
        return first - window().first;
    }
    std::unique_lock<std::mutex> turn() { return turns_.take(); }

private:
    Network network_;
    SlidingGraph graph_;
    Table<float> polarity_;  // polarity of events, by row: 1 or -1
    Convolution events_;     // the first layer, and its results by row
    Table<float> out_;
    std::vector<i64> rows_;         // rows of events that this step computed
    std::vector<Cells> pooled_;     // graphs that are pooled from the first pooled one
    std::vector<CellLayer> layers_;    // layers after the first one
    std::vector<Pooling> poolings_;    // poolings of all layers
    std::vector<Features> features_;   // results of all layers
    Readout readout_;
    i64 origin_ = 0, last_ = 0;  // origin of the times in the window; last time
    Turns turns_;

    static SlidingGraph graph_of(const Network& network) {
        require(!network.layers.empty() && network.layers[0].is_pooled && network.hidden,
                "the first layer must be pooled, and the network complete");
        // near offsets form a disk, so the farthest one along an axis is the farthest of all
        i64 far = 0;
        for (const Metric::Offset& offset : network.metric->offsets) far = std::max(far, i64(offset.x));
        Window window = network.window();
        i64 capacity = window.capacity();
        Cells cells(network.layers[0].grid, far, far, capacity, network.layers[0].kernel->reach.size() == 3);
        return {network.metric, std::move(window), std::move(cells)};
    }
    Cells& graph() { return pooled_.empty() ? graph_.cells : pooled_.back(); }

    // Remove the events before time `until`, append others, and bring everything up to date.
    void advance(i64 until, const Events& events, Interrupt& interrupt) {
        if (size() + events.size() > window().capacity()) grow(capacity_for(size() + events.size()));
        std::vector<i64> t(std::size_t(events.size()));
        for (i64 n = 0; n < events.size(); ++n) {
            t[n] = last_ = events.t[n];
            t[n] -= origin_;
            polarity_(window().row_of(window().next + n), 0) = 2 * float(events.p[n]) - 1;
        }
        graph_.slide(std::max(until, origin_) - origin_, Span<const i64>(t), events.x, events.y, interrupt);
        Cells* cells = &graph_.cells;
        for (Cells& above : pooled_) {
            cells->propagate(above);
            cells = &above;
        }
        update_events(interrupt);
        std::size_t level = 0;
        for (std::size_t n = 0; n < layers_.size(); ++n) {
            Cells& below = level ? pooled_[level - 1] : graph_.cells;
            layers_[n].update(below, features_[n], interrupt);
            if (!network_.layers[n + 1].is_pooled) {
                activate(layers_[n], features_[n + 1]);
                continue;
            }
            Cells& above = pooled_[level++];
            for (i64 row : layers_[n].rows) above.rescan.mark(below.home[row]);
            poolings_[n + 1].update(above, layers_[n].out, features_[n + 1], interrupt);
        }
        readout_.update(graph(), features_.back());
        graph_.cells.clear_marks();
        for (Cells& pooled : pooled_) pooled.clear_marks();
    }

    void update_events(Interrupt& interrupt) {
        i64 first = window().first, next = window().next;
        // for events that are still in the window
        graph_.dirty.drain(rows_, [&](i64 row) { return first + window().row_of(row - first) < next; });
        convolve(events_, window(), polarity_, Span<const i64>(rows_), out_, interrupt);
        for (i64 row : rows_) graph_.cells.rescan.mark(graph_.cell_of(row));
        poolings_[0].update(graph_.cells, out_, features_[0], interrupt);
    }

    void grow(i64 capacity) {
        i64 first = window().oldest(), next = window().next;
        widen(polarity_, capacity, first, next);
        widen(out_, capacity, first, next);
        graph_.grow(capacity);
    }
};

SlidingNetwork sliding_network(const Network& network) { return SlidingNetwork(network); }

void step(SlidingNetwork& network, i64 until, Span<const i64> t, Span<const i16> x, Span<const i16> y,
          Span<const u8> p) {
    network.step(until, {t, x, y, p});
}

i64 size(SlidingNetwork& network) {
    auto turn = network.turn();
    return network.size();
}

i64 count_before(SlidingNetwork& network, i64 until) {
    auto turn = network.turn();
    return network.count_before(until);
}

i64 products(SlidingNetwork& network) {
    auto turn = network.turn();
    return network.products();
}

void events(SlidingNetwork& network, Span<i64> t, Span<i16> x, Span<i16> y, Span<u8> p) {
    auto turn = network.turn();
    i64 n = network.size();
    require_size(t.size() == n && x.size() == n && y.size() == n && p.size() == n);
    const Window& window = network.window();
    for (i64 i = 0; i < n; ++i) {
        i64 row = window.row_of(window.first + i);
        t[i] = window.t[row] + network.origin();
        x[i] = i16(window.x[row]), y[i] = i16(window.y[row]), p[i] = network.polarity()(row, 0) > 0;
    }
}

void hidden(SlidingNetwork& network, Span<double> sum) {
    auto turn = network.turn();
    network.readout().copy_sum(sum);
}

void shown(SlidingNetwork& network, Rows<float> features) {
    auto turn = network.turn();
    network.readout().copy_shown(features);
}

}  // namespace

}  // namespace streaming

void define_sliding(nb::module_& module) {
    streaming::refuse_copies(nb::class_<streaming::SlidingNetwork>(module, "SlidingNetwork"));
    define<streaming::sliding_network>(module, "sliding_network");
    define<streaming::step>(module, "sliding_step");
    define<streaming::size>(module, "live_size");
    define<streaming::count_before>(module, "sliding_count_before");
    define<streaming::products>(module, "live_products");
    define<streaming::events>(module, "sliding_events");
    define<streaming::hidden>(module, "live_hidden");
    define<streaming::shown>(module, "live_shown");
}

}  // namespace nvsdata
