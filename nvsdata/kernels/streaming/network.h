// A network for incremental inference: its weights, which all its states share.
#pragma once

#include <mutex>

#include "../native/bind.h"
#include "pooling.h"

namespace nvsdata::streaming {

struct Network {
    struct Layer {
        std::shared_ptr<const Kernel> kernel;
        bool is_pooled, is_average;
        Grid grid;  // grid into which the rows are pooled
    };
    i64 width, height;  // size of the sensor
    i64 k;              // largest number of neighbors of an event
    std::shared_ptr<const Metric> metric;
    std::vector<Layer> layers;
    std::shared_ptr<const Table<float>> hidden;  // weights of the first fully connected layer: see `Readout`

    const Layer& last() const { return layers.back(); }
    // The grid into which the last rows are pooled; without pooling, it has cells of one pixel.
    Grid grid() const {
        for (auto layer = layers.rbegin(); layer != layers.rend(); ++layer)
            if (layer->is_pooled) return layer->grid;
        return Grid::of(width, height, 1, 1);
    }
    Window window() const { return Window(width, height, 256, k); }
    Readout readout() const { return Readout(hidden, grid().size(), last().kernel->out); }
};

// Events, in order of time, with the polarity 0 or 1.
struct Events {
    Span<const i64> t;
    Span<const i16> x, y;
    Span<const u8> p;

    i64 size() const { return t.size(); }
    Events part(i64 from, i64 to) const {
        return {t.part(from, to), x.part(from, to), y.part(from, to), p.part(from, to)};
    }

    // Throw unless all events are on the sensor and in order, from `time` on.
    void check(const Network& network, i64 time) const {
        require(x.size() == size() && y.size() == size() && p.size() == size(),
                "columns of events must be equally long");
        for (i64 i = 0; i < size(); ++i) {
            bool is_inside = x[i] >= 0 && x[i] < network.width && y[i] >= 0 && y[i] < network.height;
            require(is_inside, "an event is outside the sensor");
            require(t[i] >= time, "events must be in order of time, from 0 on");
            time = t[i];
        }
    }
};

// Lock of a state: it allows one caller at a time, and no caller after a change was interrupted.
class Turns {
public:
    std::unique_lock<std::mutex> take() {
        std::unique_lock<std::mutex> turn(*mutex_);
        if (is_changing_) throw std::runtime_error("a step of this network was interrupted: its state can't be used");
        return turn;
    }
    void begin_change() { is_changing_ = true; }
    void end_change() { is_changing_ = false; }

private:
    std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();
    bool is_changing_ = false;
};

// Make copying or pickling objects of a class fail with advice.
template <class Class>
void refuse_copies(nb::class_<Class> made) {
    made.def("__reduce_ex__", [](const Class&, int) -> nb::object {
        throw nb::type_error(
            "the state of a stream can't be copied or pickled: copy or pickle the network, and open the stream again");
    });
}

}  // namespace nvsdata::streaming
