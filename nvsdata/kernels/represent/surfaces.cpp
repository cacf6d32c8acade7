// Time surfaces: exponentials of the ages of the last events of pixels.
#include "../native/bind.h"
#include "../native/levels.h"
#include "epochs.h"

namespace nvsdata {

namespace {

constexpr i64 TABLE = 64;  // µs between events up to which the exponential is looked up

NVSDATA_INLINE void scale(const double* values, i64 count, double factor, float* out) {
    for (i64 i = 0; i < count; ++i) out[i] = float(values[i] * factor);
}

// Read the decayed values of a square of pixels. Those of the same epoch are multiplied by `shrink`, those of the epoch
// before by `older`; earlier ones are 0.
void read_square(const double* grown, const i64* epochs, i64 stride, i64 side, i64 epoch, double shrink, double older,
                 float* out) {
    // no branches, because it is unpredictable which pixels have events
    const double factors[] = {shrink, older, 0};
    for (i64 r = 0; r < side; ++r, grown += stride, epochs += stride)
        for (i64 c = 0; c < side; ++c)
            *out++ = float(grown[c] * factors[std::min<u64>(u64(epoch) - u64(epochs[c]), 2)]);
}

void surfaces(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<const i64> times,
              Span<const i64> bounds, double tau, Array<double, 3> grown, Array<float, 4> out) {
    Pixels events{x, y, p, Polarity::on_first};
    require_columns(t.size(), events);
    Images images{out.shape[3], out.shape[2]};
    i64 frames = times.size(), size = 2 * images.size;
    require_shapes(out.shape[0] == frames && out.shape[1] == 2 && grown.values.size() == size);
    require(bounds.size() == frames + 1, "frames must be one fewer than their bounds");
    std::array<double, TABLE> steps;
    for (i64 gap = 0; gap < TABLE; ++gap) steps[gap] = std::exp(double(gap) / tau);
    Interrupt interrupt;
    i64 begin = frames ? times[0] : 0;  // time from which values grow
    for (i64 n = 0; n < frames; ++n) {
        if (double(minus(times[n], begin)) > 100 * tau) {
            double factor = std::exp(double(minus(begin, times[n])) / tau);
            for (double& value : grown.values) value *= factor;
            begin = times[n];
        }
        double value = 0;
        i64 since = 0;
        check_frame(bounds, n, t.size());
        each_event(images, events, bounds[n], bounds[n + 1], interrupt, [&](i64 i, i64 place) {
            u64 gap = u64(minus(t[i], since));
            if (value > 1e-200 && gap < u64(TABLE))
                value *= steps[gap];
            else
                value = std::exp(double(minus(t[i], begin)) / tau);
            since = t[i];
            grown.values[place] = value;
        });
        double faded = std::exp(double(minus(begin, times[n])) / tau);
        best<scale>(grown.values.data(), size, faded, out.values.data() + n * size);
        interrupt.poll();
    }
}

// Surfaces around each event: `grown` and `epochs` of both polarities have a margin of `radius` pixels.
void event_surfaces(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, double tau, i64 radius,
                    Array<double, 3> grown, Array<i64, 3> epochs, Array<float, 4> out) {
    Pixels events{x, y, p, Polarity::on_first};
    require_columns(t.size(), events);
    auto [count, channels, side, columns] = out.shape;
    require_margin(radius, grown.shape[1], grown.shape[2]);
    require_shapes(count == t.size() && (channels == 1 || channels == 2) && side == 2 * radius + 1 && columns == side &&
                   grown.shape[0] == 2 && epochs.shape == grown.shape);
    Epochs clock(tau);
    i64 stride = grown.shape[2], size = grown.shape[1] * stride, middle = radius * stride + radius;
    Images images{stride - 2 * radius, grown.shape[1] - 2 * radius, stride, size};
    i64 around = side * side;
    each_event(images, events, [&, side = side, channels = channels](i64 i, i64 place) {
        i64 since = minus(t[i], t[0]), epoch = clock.of(since);
        double value = clock.value(since, epoch);
        // from 1 on, because 0 stands for a pixel without event
        epoch = plus(epoch, 1);
        grown.values[place + middle] = value;
        epochs.values[place + middle] = epoch;
        double shrink = 1 / value;
        for (i64 k = 0; k < channels; ++k) {
            i64 corner = channels == 1 ? place : place + (k - 1 + p[i]) * size;
            read_square(&grown.values[corner], &epochs.values[corner], stride, side, epoch, shrink, shrink * clock.old,
                 &out.values[(i * channels + k) * around]);
        }
    });
}

}  // namespace

void define_surfaces(nb::module_& module) {
    define<surfaces>(module, "surfaces");
    define<event_surfaces>(module, "event_surfaces");
}

}  // namespace nvsdata
