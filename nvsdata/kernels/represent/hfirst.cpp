// H-First (Orchard et al. 2015): layers of leaky integrate-and-fire neurons, event by event.
//
// Times are differences to the first event, in unsigned integers, so that a time and a refractory period can be added.
#include <algorithm>
#include <cmath>
#include <vector>

#include "../native/bind.h"
#include "../native/vector.h"
#include "events.h"

namespace nvsdata {

namespace {

// What neurons of a layer have in common: threshold in mV, leak in mV per µs, refractory period in µs.
struct Neuron {
    float threshold;
    double leak;
    u64 refractory;

    Neuron(double threshold, double leak, i64 refractory)
        : threshold(float(threshold)), leak(leak), refractory(u64(refractory)) {
        require(this->threshold > 0 && leak >= 0 && std::isfinite(leak) && refractory >= 0,
                "the threshold must be positive, leak and refractory period finite and at least 0");
    }
    float lost(u64 duration) const { return float(double(duration) * leak); }
};

// When neurons were updated, and the end of their refractory period.
struct Clock {
    u64 updated = 0, ready = 0;
};

// The potential moves towards 0, and the weight of the input is added.
NVSDATA_INLINE float updated(float potential, float lost, float weight) {
    return potential - std::max(std::min(potential, lost), -lost) + weight;
}

// The neuron with the highest potential, if that is above the threshold, or else -1; of equal ones the first.
template <class Potentials>
i64 winner(const Potentials& potentials, i64 from, i64 count, float threshold) {
    i64 best = -1;
    float highest = threshold;
    for (i64 k = 0; k < count; ++k)
        if (potentials[from + k] > highest) highest = potentials[from + k], best = k;
    return best;
}

// Simple cells: a neuron per pixel and filter, for either polarity.
struct Simple {
    Neuron neuron;
    i64 width, height, radius, lanes;  // lanes: filters, and others of zeros that fill vector registers
    const float* weights;  // [side, side, lanes]
    float* potentials;     // [2, height, width, lanes]
    Clock* clocks;         // [2, height, width]
};

// Adds an event to the neurons around it; returns how many pixels have a potential above the threshold, and which.
NVSDATA_INLINE i64 add_event(const Simple* cells, u64 now, i64 x, i64 y, i64 polarity, i64* above) {
    const Simple& s = *cells;
    i64 side = 2 * s.radius + 1, lanes = s.lanes, found = 0;
    float threshold = s.neuron.threshold;
    i64 left = std::max<i64>(x - s.radius, 0), right = std::min(x + s.radius, s.width - 1);
    i64 top = std::max<i64>(y - s.radius, 0), bottom = std::min(y + s.radius, s.height - 1);
    for (i64 row = top; row <= bottom; ++row)
        for (i64 column = left; column <= right; ++column) {
            i64 place = (polarity * s.height + row) * s.width + column;
            Clock& clock = s.clocks[place];
            if (now < clock.ready) continue;
            float lost = s.neuron.lost(now - clock.updated);
            clock.updated = now;
            float* __restrict potentials = s.potentials + place * lanes;
            // the event's position in the filter of the neuron
            const float* weights = s.weights + ((y - row + s.radius) * side + x - column + s.radius) * lanes;
            int fires = 0;
            for (i64 k = 0; k < lanes; ++k) {
                potentials[k] = updated(potentials[k], lost, weights[k]);
                fires |= potentials[k] > threshold;
            }
            if (fires) above[found++] = place;
        }
    return found;
}

// Class cells: a neuron per class, which sees all complex cells.
struct Classes {
    Neuron neuron;
    Array<const float, 4> templates;  // [classes, filters, rows, columns]
    Span<i64> votes;
    Vector<float> potentials;
    Clock clock;

    void add_spike(u64 now, i64 cell) {
        i64 count = votes.size(), size = count ? templates.values.size() / count : 0;
        if (!count || now < clock.ready) return;
        float lost = neuron.lost(now - clock.updated);
        clock.updated = now;
        for (i64 k = 0; k < count; ++k)
            potentials[k] = updated(potentials[k], lost, templates.values[k * size + cell]);
        i64 best = winner(potentials, 0, count, neuron.threshold);
        if (best < 0) return;
        ++votes[best];
        std::fill(potentials.begin(), potentials.end(), 0.0f);
        clock.ready = now + neuron.refractory;
    }
};

void spike_counts(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p,
                  Array<const float, 3> filters, double threshold, double leak, i64 refractory, i64 cell, i64 pause,
                  Array<const float, 4> templates, double class_threshold, double class_leak, i64 class_refractory,
                  Array<float, 4> potentials, Array<u64, 4> clocks, Array<i64, 3> counts, Span<i64> votes) {
    auto [count, side, other] = filters.shape;
    i64 height = potentials.shape[1], width = potentials.shape[2], lanes = potentials.shape[3];
    require_columns(t.size(), {x, y, p});
    require(cell >= 1 && cell <= 32768 && pause >= 0, "cell must be at least 1, pause at least 0");
    require_shapes(side == other && side % 2 == 1 && count <= lanes);
    require_shapes(potentials.shape == std::array<i64, 4>{2, height, width, lanes} &&
                   clocks.shape == std::array<i64, 4>{2, height, width, 2});
    i64 rows = (height + cell - 1) / cell, columns = (width + cell - 1) / cell;
    require_shapes(counts.shape == std::array<i64, 3>{count, rows, columns} &&
                   templates.shape == std::array<i64, 4>{votes.size(), count, rows, columns});

    std::vector<float> weights(std::size_t(side * side * lanes));
    for (i64 k = 0; k < count; ++k)
        for (i64 n = 0; n < side * side; ++n) weights[std::size_t(n * lanes + k)] = filters.values[k * side * side + n];
    static_assert(sizeof(Clock) == 2 * sizeof(u64));
    Simple simple{{threshold, leak, refractory}, width, height, side / 2, lanes, weights.data(), potentials.values.data(),
                  reinterpret_cast<Clock*>(clocks.values.data())};
    Classes classes{{class_threshold, class_leak, class_refractory}, templates, votes,
                    Vector<float>(std::size_t(votes.size())), {}};
    Vector<u64> ready(std::size_t(counts.values.size()));
    i64 filter_count = count, filter_lanes = lanes;
    Vector<i64> above(std::size_t(side * side));
    each_event({width, height}, {x, y, p, Polarity::off_first}, [&](i64 i, i64) {
        u64 now = u64(t[i]) - u64(t[0]);
        i64 found = best<add_event>(&simple, now, i64(x[i]), i64(y[i]), i64(p[i]), above.data());
        for (i64 n = 0; n < found; ++n) {
            i64 place = above[n], pixel = place % (width * height);
            i64 k = winner(potentials.values, place * filter_lanes, filter_count, simple.neuron.threshold);
            if (k < 0) continue;
            Span<float> there = potentials.values.part(place * filter_lanes, (place + 1) * filter_lanes);
            std::fill(there.begin(), there.end(), 0.0f);
            simple.clocks[place].ready = now + simple.neuron.refractory;
            // complex cells pass on the first spike of their pixels, and then none for a while
            i64 complex = (k * rows + pixel / width / cell) * columns + pixel % width / cell;
            if (now < ready[complex]) continue;
            ready[complex] = now + u64(pause);
            ++counts.values[complex];
            classes.add_spike(now, complex);
        }
    });
}

}  // namespace

void define_hfirst(nb::module_& module) { define<spike_counts>(module, "spike_counts"); }

}  // namespace nvsdata
