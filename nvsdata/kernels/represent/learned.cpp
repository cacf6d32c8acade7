// Sums of a piecewise linear function of the events' times.
#include <cmath>
#include <limits>
#include <vector>

#include "../native/bind.h"
#include "events.h"

namespace nvsdata {

namespace {

// Pieces of the function: their ends, and the number of a piece near each of equally spaced places from -1 to 1.
struct Pieces {
    Span<const double> ends;
    Span<const i32> nearby;
    double scale;

    Pieces(Span<const double> ends, Span<const i32> nearby)
        : ends(ends), nearby(nearby), scale(0.5 * double(nearby.size() - 1)) {
        // infinite, so that a search ends within the pieces
        constexpr double never = std::numeric_limits<double>::infinity();
        require(!ends.empty() && ends.back() == never, "the last piece must have no end");
        require(!nearby.empty(), "places must have pieces nearby");
        for (i32 piece : nearby) require(piece >= 0 && piece < ends.size(), "pieces nearby must exist");
    }
    // tau from -1 to 1
    i64 of(double tau) const {
        i64 piece = nearby[i64((tau + 1) * scale)];
        while (tau > ends[piece]) ++piece;
        return piece;
    }
};

// Calls each(s, p, place, b) for the events of each sample b, s going from 0 at its first to 1 at its last.
template <class Each>
NVSDATA_INLINE void each_of_samples(Span<const i64> t, const Images& images, const Pixels& events,
                                    Span<const i64> offsets, i64 samples, Each each) {
    require_columns(t.size(), events);
    require(offsets.size() == samples + 1, "samples must be one fewer than their offsets");
    Interrupt interrupt;
    for (i64 b = 0; b < samples; ++b) {
        check_frame(offsets, b, t.size());
        i64 first = offsets[b], last = offsets[b + 1];
        if (first >= last) continue;
        i64 begin = t[first], duration = std::max<i64>(minus(t[last - 1], begin), 1);
        double span = double(duration);
        each_event(images, events, first, last, interrupt, [&](i64 i, i64 place) {
            i64 since = minus(t[i], begin);
            require(u64(since) <= u64(duration), "times must not decrease");
            each(double(since) / span, place, b);
        });
    }
}

template <class Image, class Each>
NVSDATA_INLINE void through(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p,
                            Span<const i64> offsets, const Pieces& pieces, const Image& image, Each each) {
    auto [samples, polarities, bins, height, width] = image.shape;
    require_shapes(polarities == 2);
    Images images{width, height};
    i64 size = images.size, channels = bins;
    images.size *= channels;
    double step = 1 / double(std::max<i64>(channels - 1, 1));
    // at most 1, because n times 1 / n rounds to no more, and so s - delay is from -1 to 1
    std::vector<double> delays;
    for (i64 c = 0; c < channels; ++c) delays.push_back(double(c) * step);
    Span<const double> delay(delays);
    each_of_samples(t, images, {x, y, p, Polarity::off_first}, offsets, samples, [&](double s, i64 place, i64 b) {
        i64 cell = b * 2 * images.size + place;
        for (i64 c = 0; c < channels; ++c, cell += size) {
            double tau = s - delay[c];
            each(s, tau, pieces.of(tau), image.values[cell]);
        }
    });
}

void splat(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<const i64> offsets,
           Span<const double> ends, Span<const i32> nearby, Rows<const double> line, Array<float, 5> out) {
    require_shapes(line.rows() == ends.size() && line.columns() == 2);
    through(t, x, y, p, offsets, Pieces(ends, nearby), out, [&](double s, double tau, i64 piece, float& value) {
        value += float(s * (line(piece, 0) + line(piece, 1) * tau));
    });
}

void splat_gradient(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p,
                    Span<const i64> offsets, Span<const double> ends, Span<const i32> nearby,
                    Array<const float, 5> wanted, Rows<double> gradient) {
    require_shapes(gradient.rows() == ends.size() && gradient.columns() == 2);
    through(t, x, y, p, offsets, Pieces(ends, nearby), wanted, [&](double s, double tau, i64 piece, float value) {
        double part = s * double(value);
        gradient(piece, 0) += part;
        gradient(piece, 1) += part * tau;
    });
}

}  // namespace

void define_learned(nb::module_& module) {
    define<splat>(module, "splat");
    define<splat_gradient>(module, "splat_gradient");
}

}  // namespace nvsdata
