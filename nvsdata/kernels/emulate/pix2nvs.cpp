// PIX2NVS, one frame at a time (thesis, section 3.2): tiles that did not change are only compared.
#include <cmath>
#include <stdexcept>
#include <vector>

#include "../native/bind.h"
#include "../native/interrupt.h"
#include "brightness.h"
#include "fire.h"
#include "inhibit.h"

namespace nvsdata {

namespace {

enum Method { CO_LOCATED, AVERAGE, MINIMUM };

// See the NamedTuples of the same names in Python.
template <class Number>
struct Rule {
    Span<const Number> table;
    Number t_log, slope;
    Method method;
    Rows<const Number> sensitivity;
    i64 side;
    Number threshold, alpha;
    bool everywhere;
    Number calm;
};

template <class Number>
struct Pixels {
    Rows<Number> plane, level, reference, difference;
    i64 height() const { return level.rows(); }
    i64 width() const { return level.columns(); }
};

struct Tiles {
    Rows<bool> dirty, affected, active, still;
    Rows<i64> behind;

    void check(i64 height, i64 width) const {
        for (Rows<bool> marks : {dirty, affected, active, still}) check_tiles(marks, height, width);
        check_pixels(behind.rows(), behind.columns(), still.rows(), still.columns());
    }
};

template <class Number>
void see(Rows<const u8> frame, i64 first_weight, Span<const Number> table, Number t_log, Number slope,
         Rows<const bool> tiles, Rows<Number> plane) {
    Logarithms<Number> logarithms(plane.columns(), first_weight, table, 0, t_log, slope);
    each_box(tiles, plane.rows(), plane.columns(), [&](Box box) {
        for (i64 y = box.top; y < box.bottom; ++y)
            logarithms(frame[y], box.left, box.right, plane[y].part(box.left, box.right));
    });
}

template <class Number>
NVSDATA_INLINE void subtract(Span<const Number> level, Span<const Number> reference, Span<Number> difference) {
    for (i64 x = 0; x < difference.size(); ++x) difference[x] = level[x] - reference[x];
}

template <class Number>
NVSDATA_INLINE void multiply(Span<Number> values, Span<const Number> by) {
    for (i64 x = 0; x < values.size(); ++x) values[x] *= by[x];
}

// Three rows of references, and the reference value that a pixel's level is compared with.
template <class Number>
struct Around {
    Span<const Number> above, here, below;

    double average(i64 left, i64 x, i64 right) const {
        return (double(here[left]) + double(here[right]) + double(above[x]) + double(below[x])) / 4;
    }
    double least(i64 left, i64 right) const { return double(std::min(above[left], below[right])); }
};

// With replicated borders, only pixels at the ends of a row are their own neighbors.
template <class Number>
NVSDATA_INLINE void subtract_neighbors(Span<const Number> level, Around<Number> around, Method method, i64 begin,
                                       i64 end, Span<Number> difference) {
    i64 last = level.size() - 1;
    if (method == AVERAGE)
        for (i64 x = std::max<i64>(begin, 1); x < std::min(end, last); ++x)
            difference[x] = Number(double(level[x]) - around.average(x - 1, x, x + 1));
    else
        for (i64 x = std::max<i64>(begin, 1); x < std::min(end, last); ++x)
            difference[x] = Number(double(level[x]) - around.least(x - 1, x + 1));
    for (i64 x : {i64(0), last}) {
        if (x < begin || x >= end) continue;
        i64 left = std::max<i64>(x - 1, 0), right = std::min(x + 1, last);
        double other = method == AVERAGE ? around.average(left, x, right) : around.least(left, right);
        difference[x] = Number(double(level[x]) - other);
    }
}

// `difference` of level and reference by eq. 3.3 or 3.4, with replicated borders, times `sensitivity` if that isn't
// empty.
template <class Number>
void differ(const Rule<Number>& rule, Rows<const Number> level, Rows<const Number> reference,
            Rows<const Number> sensitivity, Rows<const bool> active, Rows<Number> difference) {
    i64 height = level.rows();
    each_box(active, height, level.columns(), [&](Box box) {
        i64 left = box.left, right = box.right;
        for (i64 y = box.top; y < box.bottom; ++y) {
            Span<Number> out = difference[y].part(left, right);
            if (rule.method == CO_LOCATED) {
                best<subtract<Number>>(level[y].part(left, right), reference[y].part(left, right), out);
            } else {
                Around<Number> around{reference[std::max<i64>(y - 1, 0)], reference[y],
                                      reference[std::min(y + 1, height - 1)]};
                best<subtract_neighbors<Number>>(level[y], around, rule.method, left, right, difference[y]);
            }
            if (rule.sensitivity.rows()) best<multiply<Number>>(out, sensitivity[y].part(left, right));
        }
    });
}

// Call `update` on a tile; return whether it isn't still.
template <class Number>
NVSDATA_INLINE void update_tile(const Rule<Number>* rule, Rows<const Number> levels, Rows<Number> references,
                                Rows<const Number> differences, Box box, bool* restless) {
    Number threshold = rule->threshold, alpha = rule->alpha, calm = rule->calm;
    bool jumps = alpha >= 1, everywhere = rule->everywhere, alone = rule->method == CO_LOCATED;
    int found = 0;
    for (i64 y = box.top; y < box.bottom; ++y) {
        Span<const Number> level = levels[y].part(box.left, box.right),
                           difference = differences[y].part(box.left, box.right);
        Span<Number> reference = references[y].part(box.left, box.right);
        for (i64 x = 0; x < level.size(); ++x) {
            Number here = level[x], before = reference[x];
            bool fired = std::abs(difference[x]) >= threshold;
            Number after = jumps ? here : before + alpha * (here - before);
            after = (everywhere | fired) ? after : before;
            reference[x] = after;
            found |= alone ? std::abs(here - after) >= calm : fired | (after != before);
        }
    }
    *restless = found;
}

// Compute new references of active tiles (eq. 3.9 and 3.10), then mark the still tiles.
//
// With alpha >= 1 the reference becomes the level. Without `everywhere`, this applies only where |difference| >=
// threshold. A tile is still if it would not fire as long as it doesn't change. Co-located differences then only
// shrink, so none may reach `calm`. Other differences depend on neighbors, so no value may have changed, and none may
// have fired.
template <class Number>
void update(const Rule<Number>& rule, Rows<const Number> level, Rows<Number> reference, Rows<const Number> difference,
            Rows<const bool> active, Rows<bool> still) {
    each_tile(active, level.rows(), level.columns(), [&](i64 r, i64 c, Box box) {
        bool restless;
        best<update_tile<Number>>(&rule, level, reference, difference, box, &restless);
        still(r, c) = !restless;
    });
}

template <class Number>
NVSDATA_INLINE void follow(Span<const Number> level, Number alpha, Span<Number> reference, bool* moved) {
    int found = 0;
    for (i64 x = 0; x < level.size(); ++x) {
        Number before = reference[x], after = before + alpha * (level[x] - before);
        reference[x] = after;
        found |= after != before;
    }
    *moved |= bool(found);
}

// Update moving averages that are behind (eq. 3.10) by exactly the omitted steps, until a step changes no value.
template <class Number>
void catch_up(Rows<Number> reference, Rows<const Number> level, Number alpha, Rows<i64> behind,
              Rows<const bool> tiles) {
    Interrupt interrupt;
    each_tile(tiles, level.rows(), level.columns(), [&](i64 r, i64 c, Box box) {
        bool moved = true;
        for (i64 n = behind(r, c); n > 0 && moved; --n) {
            moved = false;
            for (i64 y = box.top; y < box.bottom; ++y)
                best<follow<Number>>(level[y].part(box.left, box.right), alpha, reference[y].part(box.left, box.right),
                                     &moved);
            interrupt.poll();
        }
        behind(r, c) = 0;
    });
}

// Set the affected and active tiles: changed ones, those that aren't still, and relevant neighbors.
void wake(bool contrast, Method method, i64 side, const Tiles& tiles) {
    if (contrast) spread(tiles.dirty, tiles.affected);
    Span<bool> active = tiles.active.flat(), affected = tiles.affected.flat(), still = tiles.still.flat();
    for (i64 i = 0; i < active.size(); ++i) active[i] = affected[i] || !still[i];
    if (method == CO_LOCATED) return;
    spread(tiles.active, tiles.active);
    // blocks extend across tiles, and a pixel in a still tile may fire as soon as no pixel of its block inhibits it
    if (TILE_ROWS % side) std::fill(active.begin(), active.end(), true);
}

Method method_of(i64 number) {
    require(number >= CO_LOCATED && number <= MINIMUM, "no such method");
    return Method(number);
}

template <class Number>
bool mark(Rows<const u8> frame, Rows<const u8> previous, bool contrast, Method method, i64 side, Number alpha,
          bool everywhere, const Tiles& tiles, const Pixels<Number>& pixels) {
    i64 bytes = check_frames(frame, previous, pixels.height(), pixels.width());
    i64 changed = bytes ? find_dirty(frame, previous, bytes * TILE_COLUMNS, tiles.dirty) : 0;
    Span<bool> active = tiles.active.flat(), still = tiles.still.flat();
    if (changed || std::find(still.begin(), still.end(), false) != still.end()) {
        wake(contrast, method, side, tiles);
        catch_up<Number>(pixels.reference, pixels.level, alpha, tiles.behind, tiles.active);
    } else {
        std::fill(active.begin(), active.end(), false);
    }
    // whether references also change in tiles that aren't processed
    bool found = false, follows = everywhere && alpha < 1;
    for (i64 i = 0; i < active.size(); ++i) {
        found |= active[i];
        tiles.behind.flat()[i] += follows && !active[i];
    }
    return found;
}

template <class Number, class Time>
void step_bands(Rows<const u8> frame, i64 first_weight, const Rule<Number>& rule, const Tiles& tiles,
                const Pixels<Number>& pixels, Fire<Number, Time> fire, Keys& keys) {
    Interrupt interrupt;
    i64 height = pixels.height(), rows = pixels.difference.rows();
    for (i64 top = 0; top < height; top += rows) {
        i64 end = std::min(top + rows, height), first = top / TILE_ROWS, last = tiles_along(end, TILE_ROWS);
        Rows<bool> active = band(tiles.active, first, last);
        Span<bool> marks = active.flat();
        if (std::find(marks.begin(), marks.end(), true) == marks.end()) continue;
        Rows<Number> level = band(pixels.level, top, end), reference = band(pixels.reference, top, end);
        Rows<Number> difference = band(pixels.difference, 0, end - top);
        Rows<const Number> sensitivity = rule.sensitivity;
        if (sensitivity.rows()) sensitivity = band(sensitivity, top, end);
        if (frame.rows())
            see<Number>(band(frame, top, end), first_weight, rule.table, rule.t_log, rule.slope,
                        band(tiles.dirty, first, last), band(pixels.plane, top, end));
        differ<Number>(rule, level, reference, sensitivity, active, difference);
        if (rule.side > 1) inhibit<Number>(difference, rule.side, active);
        fire(difference, top, active, keys);
        update<Number>(rule, level, reference, difference, active, band(tiles.still, first, last));
        interrupt.poll();
    }
}

}  // namespace

template <class Number>
void luminance(Rows<const u8> frame, i64 first_weight, Span<const Number> table, double t_log, double slope,
               Rows<const bool> tiles, Rows<Number> plane) {
    check_tiles(tiles, plane.rows(), plane.columns());
    check_light(check_frames(frame, frame, plane.rows(), plane.columns()), first_weight, table.size(),
                sizeof(Number) == 4);
    see(frame, first_weight, table, Number(t_log), Number(slope), tiles, plane);
}

void contrast(Rows<const double> plane, Rows<const bool> tiles, bool then_log, double t_log, double slope,
              Rows<double> level) {
    i64 height = plane.rows(), width = plane.columns();
    check_tiles(tiles, height, width);
    check_pixels(level.rows(), level.columns(), height, width);
    each_box(tiles, height, width, [&](Box box) {
        for (i64 y = box.top; y < box.bottom; ++y) {
            Span<const double> row = plane[y], up = plane[std::max<i64>(y - 1, 0)],
                               down = plane[std::min(y + 1, height - 1)];
            for (i64 x = box.left; x < box.right; ++x) {
                double here = row[x];
                double sides =
                    std::abs(here - row[std::max<i64>(x - 1, 0)]) + std::abs(here - row[std::min(x + 1, width - 1)]);
                double value = (sides + std::abs(here - up[x]) + std::abs(here - down[x])) / 4;
                if (then_log) value = value > t_log ? std::log(value) : value * slope;
                level(y, x) = value;
            }
        }
    });
}

template <class Number>
bool mark_tiles(Rows<const u8> frame, Rows<const u8> previous, bool contrast, i64 method, i64 side, double alpha,
             bool everywhere, Rows<bool> dirty, Rows<bool> affected, Rows<bool> active, Rows<bool> still,
             Rows<i64> behind, Rows<Number> level, Rows<Number> reference) {
    Tiles tiles{dirty, affected, active, still, behind};
    tiles.check(level.rows(), level.columns());
    check_pixels(reference.rows(), reference.columns(), level.rows(), level.columns());
    require(side >= 1, "blocks must have a side of at least 1");
    return mark<Number>(frame, previous, contrast, method_of(method), side, Number(alpha), everywhere, tiles,
                        {level, level, reference, level});
}

template <class Number>
Keys::Result next_frame(Rows<const u8> frame, Rows<const u8> previous, i64 first_weight, bool contrast,
                        Span<const Number> table, double t_log, double slope, i64 method,
                        Rows<const Number> sensitivity, i64 side, double threshold, i64 most, i64 timing, double alpha,
                        bool everywhere, double calm, Rows<bool> dirty, Rows<bool> affected, Rows<bool> active,
                        Rows<bool> still, Rows<i64> behind, Rows<Number> plane, Rows<Number> level,
                        Rows<Number> reference, Rows<Number> difference, i64 span, u64 seed, Span<u64> place) {
    Rule<Number> rule{table, Number(t_log), Number(slope), method_of(method), sensitivity, side, Number(threshold),
                      Number(alpha), everywhere, Number(calm)};
    Pixels<Number> pixels{plane, level, reference, difference};
    Tiles tiles{dirty, affected, active, still, behind};
    i64 height = level.rows(), width = level.columns();
    tiles.check(height, width);
    check_pixels(plane.rows(), plane.columns(), height, width);
    check_pixels(reference.rows(), reference.columns(), height, width);
    if (sensitivity.rows()) check_pixels(sensitivity.rows(), sensitivity.columns(), height, width);
    check_addresses(height, width);
    // bands of entire tiles and blocks, or all rows if pixels depend on their neighbors
    i64 rows = difference.rows();
    bool fits = side >= 1 && (rows >= height ||
                              (rows >= 1 && rows % TILE_ROWS == 0 && rows % side == 0 && method == CO_LOCATED));
    require(fits, "bands must consist of whole tiles and blocks");
    check_pixels(std::min(rows, height), difference.columns(), std::min(rows, height), width);
    require(most >= 1 && timing >= INTERPOLATED && timing <= AT_ONCE && span >= 1 && span < LONGEST &&
                rule.threshold > 0,
            "settings out of range");
    Keys keys(place);
    if (frame.rows()) {
        check_light(check_frames(frame, previous, height, width), first_weight, table.size(), sizeof(Number) == 4);
        if (!mark(frame, previous, contrast, rule.method, side, rule.alpha, everywhere, tiles, pixels))
            return keys.result();
    }
    // in float32, time has 24 bits
    if (sizeof(Number) == 8 || span > 1 << 21)
        step_bands(frame, first_weight, rule, tiles, pixels,
                   Fire<Number, double>(width, rule.threshold, most, Timing(timing), span, seed), keys);
    else
        step_bands(frame, first_weight, rule, tiles, pixels,
                   Fire<Number, Number>(width, rule.threshold, most, Timing(timing), span, seed), keys);
    return keys.result();
}

void define_pix2nvs(nb::module_& module) {
    define<luminance<float>, luminance<double>>(module, "luminance");
    define<contrast>(module, "contrast");
    define<mark_tiles<float>, mark_tiles<double>>(module, "mark_tiles");
    define<next_frame<float>, next_frame<double>>(module, "next_frame");
}

}  // namespace nvsdata
