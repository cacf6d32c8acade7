// Images of the latest events of pixels: their times, and leaky sums.
#include <cmath>

#include "../native/bind.h"
#include "events.h"

namespace nvsdata {

namespace {

void counts_and_times(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 start,
                      i64 duration, Array<float, 3> out) {
    Pixels events{x, y, p, Polarity::on_first};
    require_columns(t.size(), events);
    require_shapes(out.shape[0] == 4);
    Images images{out.shape[2], out.shape[1]};
    Span<float> counts = out.values.part(0, 2 * images.size), times = out.values.part(2 * images.size, 4 * images.size);
    each_event(images, events, [=](i64 i, i64 place) {
        counts[place] += 1;
        times[place] = float(double(minus(t[i], start)) / double(duration));
    });
}

void leak_into(Span<const i64> t, Span<const i16> x, Span<const i16> y, double increment, double leak,
               Rows<double> value, Rows<i64> since) {
    require_columns(t.size(), {x, y});
    require_shapes(value.rows() == since.rows() && value.columns() == since.columns());
    Span<double> values = value.flat();
    Span<i64> times = since.flat();
    each_event({value.columns(), value.rows()}, {x, y}, [&](i64 i, i64 place) {
        double left = values[place] - leak * double(minus(t[i], times[place]));
        values[place] = (left > 0.0 ? left : 0.0) + increment;
        times[place] = t[i];
    });
}

void push_times(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, Array<i64, 4> times,
              Array<i64, 3> counts) {
    Pixels events{x, y, p, Polarity::on_first};
    require_columns(t.size(), events);
    auto [polarities, k, height, width] = times.shape;
    require_shapes(k >= 1 && polarities == 2 && counts.shape == std::array<i64, 3>{2, height, width});
    Images images{width, height};
    u64 depth = u64(k);
    each_event(images, events, [&](i64 i, i64 place) {
        u64 count = u64(counts.values[place]), slot = count % depth, polarity = 1 - p[i];
        counts.values[place] = i64(count + 1);
        // the images of all slots of one polarity come before those of the other
        times.values[place + i64((polarity * (depth - 1) + slot) * u64(images.size))] = t[i];
    });
}

double logarithm(i64 age, double least, double most) {
    return std::min(std::max(std::log1p(double(age)), least), most) - least;
}

void logarithms(Span<const i64> age, Span<const bool> known, double least, double most, Span<float> out) {
    require_shapes(known.size() == age.size() && out.size() == age.size());
    Interrupt interrupt;
    for (i64 from = 0; from < age.size(); from += STEPS) {
        i64 to = std::min(from + STEPS, age.size());
        for (i64 i = from; i < to; ++i) out[i] = float(known[i] ? logarithm(age[i], least, most) : most - least);
        interrupt.poll();
    }
}

void logarithms_of_ages(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 end,
                        double least, double most, Array<i32, 3> have, Array<float, 4> out) {
    Pixels events{x, y, p, Polarity::on_first};
    require_columns(t.size(), events);
    auto [polarities, k, height, width] = out.shape;
    require_shapes(polarities == 2 && have.shape == std::array<i64, 3>{2, height, width});
    Images images{width, height};
    Interrupt interrupt;
    u32 places[STEPS];
    i64 depth = k;
    // the latest event comes first
    for (i64 to = t.size(); to > 0; to -= std::min(to, STEPS)) {
        i64 from = to - std::min(to, STEPS);
        place_all(images, events, from, to, places);
        for (i64 i = to - 1; i >= from; --i) {
            i64 place = places[i - from];
            u32 slot = u32(have.values[place]);
            if (slot >= u64(depth)) continue;
            i64 image = (1 - p[i]) * (depth - 1) + slot;
            out.values[place + image * images.size] = float(logarithm(minus(end, t[i]), least, most));
            have.values[place] = i32(slot + 1);
        }
        interrupt.poll();
    }
}

// For each pixel and polarity, a ring buffer of bins of time: their numbers, and the sum and number of the times in
// each.
void queue_bins(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 origin, i64 duration,
                Array<i64, 4> bins, Array<double, 5> within, Array<i64, 3> used) {
    Pixels events{x, y, p, Polarity::off_first};
    require_columns(t.size(), events);
    auto [polarities, height, width, depth] = bins.shape;
    require(duration >= 1, "bins must have a duration");
    require_shapes(polarities == 2 && depth >= 1 && used.shape == std::array<i64, 3>{2, height, width} &&
                   within.shape == std::array<i64, 5>{2, height, width, depth, 2});
    each_event({width, height}, events, [&, depth = u64(depth)](i64 i, i64 place) {
        i64 since = minus(t[i], origin), number = floor_divide(since, duration);
        double gap = double(minus(since, times(number, duration)));
        u64 begun = u64(used.values[place]);
        i64 slot = place * i64(depth) + i64((begun - 1) % depth);
        if (begun && bins.values[slot] == number) {
            within.values[2 * slot] += gap;
            within.values[2 * slot + 1] += 1;
            return;
        }
        slot = place * i64(depth) + i64(begun % depth);
        used.values[place] = i64(begun + 1);
        bins.values[slot] = number;
        within.values[2 * slot] = gap, within.values[2 * slot + 1] = 1;
    });
}

void ages_of_bins(i64 since, i64 duration, Array<i64, 4> bins, Array<double, 5> within, Array<i64, 3> used,
                  Array<float, 4> out) {
    auto [polarities, height, width, depth] = bins.shape;
    require_shapes(polarities == 2 && used.shape == std::array<i64, 3>{2, height, width} &&
                   within.shape == std::array<i64, 5>{2, height, width, depth, 2} &&
                   out.shape == std::array<i64, 4>{depth, 2, height, width});
    i64 places = used.values.size(), most = depth;
    Interrupt interrupt;
    for (i64 from = 0; from < places; from += STEPS) {
        for (i64 place = from, to = std::min(from + STEPS, places); place < to; ++place) {
            // a loop of its own, because most queues are empty
            while (place < to && used.values[place] == 0) ++place;
            if (place == to) break;
            i64 begun = used.values[place], kept = std::min(begun, most);
            for (i64 back = 0; back < kept; ++back) {
                i64 slot = place * most + (begun - 1 - back) % most;
                double begin = double(minus(since, times(bins.values[slot], duration)));
                double age = begin - within.values[2 * slot] / within.values[2 * slot + 1];
                double fallen = 1 - std::log1p(std::max(age / double(duration), 0.0)) / 8.7;
                out.values[(most - 1 - back) * places + place] = float(std::max(fallen, 0.0));
            }
        }
        interrupt.poll();
    }
}

void latest_ticks(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p, i64 start, i64 tick,
                  i64 now, double decay, Array<float, 4> out) {
    Pixels events{x, y, p, Polarity::on_first};
    require_columns(t.size(), events);
    require(tick >= 1, "ticks must have a duration");
    require_shapes(out.shape[1] == 2);
    Images images{out.shape[3], out.shape[2]};
    i64 filters = out.shape[0];
    each_event(images, events, [&](i64 i, i64 place) {
        i64 age = minus(minus(now, 1), floor_divide(minus(t[i], start), tick));
        // filters with a longer delay don't contain the event yet
        for (i64 k = 0; k < filters && k <= age; ++k) {
            float& value = out.values[place + 2 * k * images.size];
            value = std::max(float(1 - double(age - k) / decay), value);
        }
    });
}

}  // namespace

void define_latest(nb::module_& module) {
    define<counts_and_times>(module, "counts_and_times");
    define<leak_into>(module, "leak_into");
    define<push_times>(module, "push_times");
    define<logarithms>(module, "logarithms");
    define<logarithms_of_ages>(module, "logarithms_of_ages");
    define<queue_bins>(module, "queue_bins");
    define<ages_of_bins>(module, "ages_of_bins");
    define<latest_ticks>(module, "latest_ticks");
}

}  // namespace nvsdata
