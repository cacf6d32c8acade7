// Pixels with a photoreceptor of first order, whose bandwidth increases with the light: see the Python module.
#include <cmath>

#include "../native/bind.h"
#include "../native/interrupt.h"
#include "sensor.h"

namespace nvsdata {

namespace {

constexpr double CHANGE = 0.1;  // largest change of the logarithm of light in a step of a pixel
constexpr double MOST_PARTS = 1e6;  // largest number of steps; more only if a light isn't finite
constexpr double CLOSE = 0.01;  // error of a crossing in µs
constexpr int TRIES = 60;       // number of halvings after which a crossing is found
constexpr double EARLY = 1.0;   // µs by which tiles wake early, because of rounding
// logarithms of light: a lag that is too small for a turning point, and the largest sum of rounding errors
constexpr double TINY = 1e-12;

// Rate in 1/µs. As in v2e, it is (I + 20) / 275 times that of a white pixel, `speed`.
double rate(double light, double dark, double speed) { return speed * (light - dark / 1000 + 20) / 275; }

// The level above a memory: base + slope t - lag exp(-speed t).
struct Curve {
    double base, slope, lag, speed;

    double far(double t) const { return lag * std::exp(-speed * t); }
    double at(double t) const { return base + slope * t - far(t); }

    // The time at which the level is `by`; it is monotonic from `first` to `last`.
    double crossing(double by, double first, double last) const {
        double low = base - by;
        double sign = low + slope * last - far(last) > 0 ? 1 : -1;
        double t = last;
        for (int n = 0; n < TRIES; ++n) {
            double rest = far(t), value = low + slope * t - rest;
            (value * sign > 0 ? last : first) = t;
            double steep = slope + speed * rest;
            // a step by Newton's method, or half of the interval
            double next = steep != 0 ? t - value / steep : first - 1;
            if (!(first <= next && next <= last)) next = 0.5 * (first + last);
            if (std::abs(next - t) < CLOSE) return next;
            t = next;
        }
        return t;
    }
};

struct Pixel {
    double off, on;
    u32 low;  // half of its keys
};

class Receptors {
public:
    Receptors(const Light<double>& light, const Sensor<double>& sensor, const PixelArray<double>& array,
              Rows<double> reached, Rows<double> speed, Rows<i64> since, double white, i64 before, i64 now, Keys& keys)
        : rousing_(light, sensor, array),
          sensor_(sensor),
          array_(array),
          reached_(reached),
          speed_(speed),
          since_(since),
          dark_(double(sensor.dark)),
          white_(white),
          leak_(sensor.leak),
          before_(before),
          now_(now),
          keys_(keys) {}

    void run() {
        rousing_.each_row(now_, [&](i64 y) {
            for (i64 tile = 0; tile < rousing_.active().size(); ++tile)
                if (rousing_.active()[tile]) follow(y, tile);
            interrupt_.poll();
        });
        for (i64 r = 0; r < since_.rows(); ++r)
            for (i64 c = 0; c < since_.columns(); ++c)
                if (array_.dirty(r, c)) since_(r, c) = now_;
    }

private:
    Rousing<double> rousing_;
    const Sensor<double>& sensor_;
    const PixelArray<double>& array_;
    Rows<double> reached_, speed_;
    Rows<i64> since_;
    double dark_, white_, leak_;
    i64 before_, now_;
    Keys& keys_;
    Interrupt interrupt_;
    u64 fired_ = 0;

    // Add the events of a tile's row while the light changes to `end`, and update the state.
    void follow(i64 y, i64 tile) {
        Span<double> level = array_.level[y], memory = array_.memory[y], reached = reached_[y], speed = speed_[y];
        Span<const double> end(rousing_.end), off = sensor_.off(y, level.size()), on = sensor_.on(y, level.size());
        bool changed = array_.dirty(y / TILE_ROWS, tile);
        i64& wake = array_.wake(y / TILE_ROWS, tile);
        i64 since = since_(y / TILE_ROWS, tile), origin = changed ? now_ : since;
        for (i64 i = tile * TILE_COLUMNS; i < std::min((tile + 1) * TILE_COLUMNS, level.size()); ++i) {
            Pixel pixel{off.empty() ? sensor_.off() : off[i], on.empty() ? sensor_.on() : on[i], u32(y << 17 | i << 1)};
            require(pixel.off > 0 && pixel.on > 0, "thresholds must be above 0");
            double lag = level[i] - reached[i];
            if (!changed) {
                if (lag != 0 || leak_ != 0) {
                    Curve curve{level[i] - memory[i] + leak_ * double(since), leak_, lag, speed[i]};
                    double begin = double(before_ - since);
                    memory[i] = fire(curve, begin, double(now_ - since), begin, pixel, memory[i]);
                }
            } else {
                if (lag != 0) lag *= std::exp(-speed[i] * double(before_ - since));
                lag = along(level[i], end[i], lag, speed[i], pixel, memory[i]);
                if (end[i] != level[i]) speed[i] = rate(std::exp(end[i]), dark_, white_);
                level[i] = end[i];
                reached[i] = end[i] - lag;
            }
            if (wake > now_)
                wake = std::min(wake, next(level[i] - memory[i], level[i] - reached[i], speed[i], origin, pixel));
        }
    }

    // The lag behind the light after the light of a pixel has changed from `a` to `b`. Its memory is updated.
    double along(double a, double b, double lag, double speed, const Pixel& pixel, double& memory) {
        double whole = double(now_ - before_);
        if (a == b) {
            if (lag != 0 || leak_ != 0)
                memory = fire({a - memory + leak_ * double(before_), leak_, lag, speed}, 0, whole, 0, pixel, memory);
            return lag * std::exp(-speed * whole);
        }
        double parts = std::abs(b - a) / CHANGE;
        if (!(parts < MOST_PARTS)) return lag;
        i64 steps = i64(std::ceil(parts));
        double change = (b - a) / double(steps), span = whole / double(steps);
        double grows = std::exp(change), bright = std::exp(a);
        for (i64 k = 0; k < steps; ++k) {
            // the mean of the rate along the step
            speed = rate(bright * (grows - 1) / change, dark_, white_);
            bright *= grows;
            double light = a + double(k) * change, behind = change / span / speed;
            double since = double(before_) + double(k) * span;
            // the photoreceptor doesn't overtake the light
            double highest = std::max(std::max(light - lag, light), light + change);
            double lowest = std::min(std::min(light - lag, light), light + change);
            if (highest - memory + leak_ * (since + span) >= pixel.on ||
                lowest - memory + leak_ * since <= -pixel.off) {
                Curve curve{light - behind - memory + leak_ * since, change / span + leak_, lag - behind, speed};
                memory = fire(curve, 0, span, double(-k) * span, pixel, memory);
            }
            lag = behind + (lag - behind) * std::exp(-speed * span);
        }
        return lag;
    }

    // The memory after a part of a curve, from `begin` to `last`; adds keys, whose times are in µs from `start`.
    double fire(const Curve& curve, double begin, double last, double start, const Pixel& pixel, double memory) {
        // the turning point of the curve, if there is one
        double turn = std::abs(curve.lag) > TINY ? -curve.slope / (curve.speed * curve.lag) : -1;
        double middle = last;
        if (0 < turn && turn < 1) middle = std::min(std::max(-std::log(turn) / curve.speed, begin), last);
        double a = curve.at(begin), moved = 0;
        for (double stop : {middle, last}) {
            double b = curve.at(stop), at = begin;
            if (!std::isfinite(b)) break;  // it would fire forever
            bool up = b > a;
            double step = up ? pixel.on : -pixel.off;
            while (up ? b - moved >= step : b - moved <= step) {
                moved += step;
                at = curve.crossing(moved, at, stop);
                *keys_.room(1) = u64(clamped(at - start + 0.5, i64(UINT32_MAX))) << 32 | pixel.low | u32(up);
                keys_.add(1);
                if (++fired_ % 4096 == 0) interrupt_.poll();
            }
            if (middle == last) break;
            begin = stop, a = b;
        }
        return memory + moved;
    }

    // A time in µs before which a pixel with constant light doesn't fire. `ahead` is the light above its memory.
    i64 next(double ahead, double lag, double speed, i64 origin, const Pixel& pixel) const {
        if (leak_ != 0) {
            lag *= std::exp(-speed * double(now_ - origin));
            double level = ahead + leak_ * double(now_);
            double highest = level + std::max(-lag, 0.0), lowest = level - std::max(lag, 0.0);
            if (highest >= pixel.on || lowest <= -pixel.off) return now_;
            return now_ + pause((pixel.on - highest) / leak_ - EARLY);
        }
        // upward or downward; because of rounding the time is earlier
        double room = (lag > 0 ? ahead - pixel.on : -pixel.off - ahead) + TINY;
        if (room <= 0 || room >= std::abs(lag)) return room >= std::abs(lag) ? now_ : NEVER;
        return origin + pause(std::log(std::abs(lag) / room) / speed - EARLY);
    }
};

}  // namespace

Keys::Result advance_receptors(Rows<const u8> frame, Rows<const u8> previous, i64 first_weight,
                               Rows<const double> given, Span<const double> table, i64 dark,
                               Span<const double> thresholds, Span<const double> each, double leak, double white,
                               Rows<double> level, Rows<double> memory, Rows<double> reached, Rows<double> speed,
                               Rows<bool> dirty, Rows<i64> wake, Rows<i64> since, i64 before, i64 now,
                               Span<u64> place) {
    Light<double> light{frame, previous, first_weight, given};
    Sensor<double> sensor{table, dark, thresholds, each, leak};
    PixelArray<double> array{level, memory, dirty, wake};
    check_sensor(light, sensor, array, before, now);
    check_pixels(reached.rows(), reached.columns(), level.rows(), level.columns());
    check_pixels(speed.rows(), speed.columns(), level.rows(), level.columns());
    check_pixels(since.rows(), since.columns(), wake.rows(), wake.columns());
    for (i64 time : since.flat())
        require(time >= 0 && time <= before, "tiles changed in the future");
    Keys keys(place);
    Receptors(light, sensor, array, reached, speed, since, white, before, now, keys).run();
    return keys.result();
}

void receptor_rates(Span<const double> level, i64 dark, double white, Span<double> out) {
    check_pixels(1, out.size(), 1, level.size());
    for (i64 i = 0; i < out.size(); ++i) out[i] = rate(std::exp(level[i]), double(dark), white);
}

void define_photoreceptor(nb::module_& module) {
    define<advance_receptors>(module, "advance_receptors");
    define<receptor_rates>(module, "receptor_rates");
}

}  // namespace nvsdata
