// Networks on causal graphs, event by event: computed rows never change, and only pooled maxima are updated.
#include "../native/bind.h"
#include "network.h"

namespace nvsdata {

namespace streaming {

namespace {

// The events of each cell, in order, and the pooled maxima of their features.
//
// In the older part of a cell's queue, each event has the maximum over itself and the later events of this part. The
// newer part has a single maximum. So an event costs one comparison of rows when it arrives and one when it leaves.
class Queues {
public:
    i64 first = 0;  // number of the first event in the queues
    Marks changed;  // cells whose maxima may have changed

    Queues(Grid grid, i64 capacity, i64 channels)
        : changed(grid.size()), grid_(grid), head_(grid.size()), tail_(grid.size()), settled_(grid.size()),
          after_(capacity), previous_(capacity), newer_(grid.size(), channels) {
        head_.fill(-1), tail_.fill(-1), settled_.fill(-1);
    }

    // Append an event to its cell's queue.
    void enter(const Window& window, i64 number, Span<const float> values) {
        i64 row = window.row_of(number), cell = cell_of(window, row), tail = tail_[cell];
        previous_[row] = tail, after_[row] = -1;
        (tail >= 0 ? after_[window.row_of(tail)] : head_[cell]) = number;
        tail_[cell] = number;
        keep_larger(newer_[cell], values);
        changed.mark(cell);
    }

    // Remove the oldest event, which is the first of its cell's queue.
    void leave(const Window& window, Table<float>& values) {
        i64 number = first++, row = window.row_of(number), cell = cell_of(window, row);
        if (settled_[cell] < number) {
            // the older part is empty, so the newer part takes its place
            settled_[cell] = tail_[cell];
            for (i64 at = previous_[window.row_of(tail_[cell])]; at >= number;) {
                i64 here = window.row_of(at);
                keep_larger(values[here], values[window.row_of(after_[here])]);
                at = previous_[here];
            }
            for (float& value : newer_[cell]) value = 0;
        }
        i64 after = after_[row];
        head_[cell] = after;
        (after >= 0 ? previous_[window.row_of(after)] : tail_[cell]) = -1;
        changed.mark(cell);
    }

    // The maxima of a cell.
    void read(const Window& window, const Table<float>& values, i64 cell, std::vector<float>& maxima) const {
        Span<const float> newer = newer_[cell];
        maxima.assign(newer.begin(), newer.end());
        i64 head = head_[cell];
        if (head < 0 || head > settled_[cell]) return;
        Span<const float> older = values[window.row_of(head)];
        for (std::size_t c = 0; c < maxima.size(); ++c)
            if (!(maxima[c] >= older[c]) && maxima[c] == maxima[c]) maxima[c] = older[c];  // NaN stays
    }

    void grow(i64 capacity, i64 from, i64 next) {
        widen(after_, capacity, from, next);
        widen(previous_, capacity, from, next);
    }

private:
    Grid grid_;
    Column<i64> head_, tail_, settled_;  // by cell: first event, last event, last event of the older part
    Column<i64> after_, previous_;       // by row: the next and the previous event in the queue, or -1
    Table<float> newer_;                 // maxima of the newer parts

    i64 cell_of(const Window& window, i64 row) const { return grid_.cell_of(window.x[row], window.y[row]); }
    static void keep_larger(Span<float> largest, Span<const float> values) {
        float* out = largest.data();
        const float* in = values.data();
        for (i64 c = 0; c < largest.size(); ++c) out[c] = std::max(out[c], in[c]);
    }
};

class CausalNetwork {
public:
    CausalNetwork(const Network& network, i64 age)
        : network_(network), age_(age), window_(network.window()), readout_(network.readout()),
          queues_(network.last().grid, window_.capacity(), network.last().kernel->out) {
        features_.emplace_back(window_.capacity(), 1);
        for (const Network::Layer& layer : network.layers) {
            layers_.emplace_back(layer.kernel);
            features_.emplace_back(window_.capacity(), layer.kernel->out);
        }
    }

    // Add events, `together` at a time, and remove those before time `until`.
    void step(i64 until, const Events& events, i64 together) {
        auto turn = turns_.take();
        events.check(network_, last_);
        require_size(together > 0);
        turns_.begin_change();
        Interrupt interrupt;
        i64 from = 0;
        for (; events.size() - from > together; from += together)
            advance(INT64_MIN, events.part(from, from + together), interrupt);
        advance(until, events.part(from, events.size()), interrupt);
        turns_.end_change();
    }

    // Compute the first fully connected layer from the maxima.
    template <class Read>
    void read(Read read) {
        auto turn = turns_.take();
        turns_.begin_change();
        std::vector<float> maxima;
        for (i64 cell : queues_.changed.numbers()) {
            queues_.read(window_, features_.back(), cell, maxima);
            readout_.show(cell, Span<const float>(maxima));
        }
        queues_.changed.clear();
        turns_.end_change();
        read(readout_);
    }
    i64 size() {
        auto turn = turns_.take();
        return window_.size();
    }
    i64 products() {
        auto turn = turns_.take();
        i64 sum = readout_.products;
        for (const Convolution& layer : layers_) sum += layer.products;
        return sum;
    }

private:
    Network network_;
    i64 age_, last_ = 0;
    Window window_;
    std::vector<Convolution> layers_;
    std::vector<Table<float>> features_;  // inputs of each layer, and results of the last layer, by row
    Readout readout_;
    Queues queues_;
    std::vector<i64> rows_;
    Turns turns_;

    // Neighbors of an event are among the events of the last `age_` µs before it.
    void advance(i64 until, const Events& events, Interrupt& interrupt) {
        // and events whose last rows are still in queues
        i64 count = window_.next - queues_.first + events.size(), first = window_.next;
        if (count > window_.capacity()) grow(capacity_for(count));
        rows_.clear();
        for (i64 n = 0; n < events.size(); ++n) {
            forget(events.t[n] - age_ + 1);
            window_.push(events.t[n], events.x[n], events.y[n]);
            window_.search(first + n, *network_.metric);
            rows_.push_back(window_.row_of(first + n));
            if (n % 256 == 0) interrupt.poll();
            features_[0](rows_.back(), 0) = 2 * float(events.p[n]) - 1;
            last_ = events.t[n];
        }
        for (std::size_t n = 0; n < layers_.size(); ++n) {
            convolve(layers_[n], window_, features_[n], Span<const i64>(rows_), features_[n + 1], interrupt);
            for (i64 row : rows_)
                for (float& value : features_[n + 1][row]) value = std::max(value, 0.0f);
        }
        forget(until);
        while (queues_.first < std::min(window_.first, first)) queues_.leave(window_, features_.back());
        queues_.first = std::max(queues_.first, window_.first);
        for (i64 number = std::max(first, window_.first); number < window_.next; ++number)
            queues_.enter(window_, number, features_.back()[window_.row_of(number)]);
    }

    // Remove the events before a time from the window.
    void forget(i64 until) {
        while (window_.size() && window_.t[window_.row_of(window_.first)] < until) window_.pop();
    }

    void grow(i64 capacity) {
        i64 from = window_.oldest(), next = window_.next;
        for (Table<float>& features : features_) widen(features, capacity, from, next);
        queues_.grow(capacity, from, next);
        window_.grow(capacity);
    }
};

CausalNetwork causal_network(const Network& network, i64 age) {
    require(age >= 1, "the window must be at least 1 µs long");
    require(!network.layers.empty() && network.hidden && !network.last().is_average,
            "the last layer must be pooled by maxima, and the network complete");
    for (const Network::Layer& layer : network.layers)
        require(layer.is_pooled == (&layer == &network.last()), "only the last layer may be pooled");
    return {network, age};
}

void step(CausalNetwork& network, i64 until, Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p,
          i64 together) {
    network.step(until, {t, x, y, p}, together);
}

i64 size(CausalNetwork& network) { return network.size(); }

i64 products(CausalNetwork& network) { return network.products(); }

void hidden(CausalNetwork& network, Span<double> sum) {
    network.read([&](const Readout& readout) { readout.copy_sum(sum); });
}

void shown(CausalNetwork& network, Rows<float> features) {
    network.read([&](const Readout& readout) { readout.copy_shown(features); });
}

}  // namespace

}  // namespace streaming

void define_causal(nb::module_& module) {
    streaming::refuse_copies(nb::class_<streaming::CausalNetwork>(module, "CausalNetwork"));
    define<streaming::causal_network>(module, "causal_network");
    define<streaming::step>(module, "causal_step");
    define<streaming::size>(module, "live_size");
    define<streaming::products>(module, "live_products");
    define<streaming::hidden>(module, "live_hidden");
    define<streaming::shown>(module, "live_shown");
}

}  // namespace nvsdata
