// Events summed into the cells of a grid in time and space.
#include <type_traits>

#include "../native/bind.h"
#include "events.h"

namespace nvsdata {

namespace {

template <class T = float>
T sign(u8 p) {
    static constexpr T signs[] = {-1, 1};
    return signs[p];
}

template <class T>
using Step = std::conditional_t<std::is_integral_v<T>, int, T>;

// Add to a count; an integer is clipped to its range.
template <class T>
void add(T& count, Step<T> step) {
    Step<T> sum = count + step;
    // a branch, because counts are rarely clipped
    if (std::is_floating_point_v<T> || T(sum) == sum) count = T(sum);
}

void sum_frames(Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<const i64> bounds, i64 width, i64 height,
                i64 factor, Array<float, 3> out) {
    auto [frames, rows, columns] = out.shape;
    require(factor >= 1 && factor <= 32768, "factor must be at least 1");
    require_shapes(rows == (height + factor - 1) / factor && columns == (width + factor - 1) / factor);
    Images images{width, height};
    Pixels events{x, y, p};
    auto frame = [&, size = rows * columns](i64 n) { return out.values.part(n * size, (n + 1) * size); };
    if (factor == 1) {
        each_event_of_frames(images, events, bounds, frames, [&](i64 n) {
            return [sums = frame(n), p](i64 i, i64 place) { sums[place] += sign(p[i]); };
        });
        return;
    }
    auto add = [&, side = u32(factor), columns = columns](i64 n) {
        return [=, sums = frame(n)](i64 i, i64) { sums[u32(y[i]) / side * columns + u32(x[i]) / side] += sign(p[i]); };
    };
    auto average = [&, rows = rows, columns = columns](i64 n) {
        Rows<float> sums{frame(n).data(), rows, columns};
        for (i64 r = 0; r < rows; ++r) {
            i64 tall = std::min(factor, height - r * factor);
            for (i64 c = 0; c < columns; ++c) sums(r, c) /= float(tall * std::min(factor, width - c * factor));
        }
    };
    each_event_of_frames(images, events, bounds, frames, add, average);
}

template <class T>
void counted(Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<const i64> bounds, Array<T, 4> out) {
    i64 channels = out.shape[1];
    require(channels == 1 || channels == 2, "frames must have one or two channels");
    Images images{out.shape[3], out.shape[2]};
    auto frame = [&, size = channels * images.size](i64 n) { return out.values.part(n * size, (n + 1) * size); };
    if (channels == 1)
        each_event_of_frames(images, {x, y, p}, bounds, out.shape[0], [&](i64 n) {
            return [counts = frame(n), p](i64 i, i64 place) { add(counts[place], sign<Step<T>>(p[i])); };
        });
    else
        each_event_of_frames(images, {x, y, p, Polarity::on_first}, bounds, out.shape[0], [&](i64 n) {
            return [counts = frame(n)](i64, i64 place) { add(counts[place], Step<T>(1)); };
        });
}

void counted_by_polarity(Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<const i64> bounds,
                         Array<float, 4> out) {
    require_shapes(out.shape[0] == 2);
    Images images{out.shape[3], out.shape[2]};
    i64 frames = out.shape[1];
    each_event_of_frames(images, {x, y, p}, bounds, frames, [&](i64 n) {
        return [=](i64 i, i64 place) { out.values[(p[i] * frames + n) * images.size + place] += 1; };
    });
}

template <class T>
void marked(Span<const i16> x, Span<const i16> y, Span<const u8> p, Span<const i64> bounds, Array<T, 4> out) {
    require_shapes(out.shape[1] == 2);
    Images images{out.shape[3], out.shape[2]};
    each_event_of_frames(images, {x, y, p, Polarity::on_first}, bounds, out.shape[0],
                         [&, size = 2 * images.size](i64 n) {
                             return [marks = out.values.part(n * size, (n + 1) * size)](i64, i64 place) {
                                 marks[place] = 1;
                             };
                         });
}

void spread(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, bool linear,
            Array<float, 3> out) {
    Pixels events{x, y, p};
    require_columns(t.size(), events);
    if (t.empty()) return;
    i64 last = out.shape[0] - 1;
    require(last >= 0, "there must be a bin");
    Images images{out.shape[2], out.shape[1]};
    i64 first = t[0], duration = minus(t.back(), first);
    require(duration >= 0, "times must not decrease");
    // if all times are equal, all events are in the first bin
    double scale = duration ? double(last) : 0, span = duration ? double(duration) : 1;
    Interrupt interrupt;
    some_events(images, events, 0, t.size(), interrupt, [&](i64 from, i64 count, const u32* places) {
        double at[STEPS];
        // so bins are within the grid, because rounding doesn't reach the next integer
        require(scale_times(t.data() + from, count, first, u64(duration), scale, span, at), "times must not decrease");
        for (i64 k = 0; k < count; ++k) {
            float step = sign(p[from + k]);
            i64 bin = linear ? i64(at[k]) : i64(at[k] + 0.5);
            float later = linear ? float(at[k] - double(bin)) : 0;
            out.values[bin * images.size + places[k]] += step * (1 - later);
            if (linear && bin < last) out.values[(bin + 1) * images.size + places[k]] += step * later;
        }
    });
}

}  // namespace

void define_frames(nb::module_& module) {
    define<sum_frames>(module, "sum_frames");
    define<counted<float>, counted<u8>, counted<i16>>(module, "counted");
    define<counted_by_polarity>(module, "counted_by_polarity");
    define<marked<float>, marked<u8>, marked<i16>>(module, "marked");
    define<spread>(module, "spread");
}

}  // namespace nvsdata
