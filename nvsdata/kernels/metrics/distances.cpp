// Spikes of a frame on the pixel lattice, and the nearest spike of another frame to each.
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "../native/bind.h"
#include "../native/indexes.h"
#include "../native/interrupt.h"
#include "../native/levels.h"
#include "../native/require.h"
#include "../native/steps.h"
#include "../native/vector.h"

namespace nvsdata {

namespace {

constexpr i64 MARGIN = 6;     // pixels around a map, and the distance up to which neighbors are looked up one by one
constexpr i64 CELL = 16;      // side in pixels of the cells that are searched beyond that
constexpr i64 UNASKED = 21;   // the pixel itself and the twenty nearest ones, which are always searched
constexpr i64 SPARSE = 64;    // pixels per spike from which on cells are searched immediately
constexpr i64 PATIENCE = 1024;  // spikes between two polls for Ctrl-C

struct Spikes {
    Span<const i64> x, y, value;

    void check(i64 height, i64 width) const {
        require(x.size() == y.size() && x.size() == value.size(), "columns of spikes differ in length");
        check_below(x, width, "a spike is outside the frame");
        check_below(y, height, "a spike is outside the frame");
    }
};

double cost(double square, double weight, double apart) { return square + weight * apart * apart; }

// By value, so that it compiles to one instruction; `a` if b is NaN.
template <class Float>
Float lesser(Float a, Float b) {
    return b < a ? b : a;
}

// Search the map around each spike, and lower the least costs.
NVSDATA_INLINE void look_around(Span<const i64> x, Span<const i64> y, Span<const i64> value, Span<const float> lattice,
                                i64 stride, Span<const i64> steps, Span<const double> squares, double weight,
                                Span<double> least, bool* lonely) {
    for (i64 i = 0; i < x.size(); ++i) {
        i64 home = (y[i] + MARGIN) * stride + x[i] + MARGIN;
        // integers, whose differences are exact in single precision
        float own = float(value[i]);
        auto apart = [&](i64 at) { return std::abs(own - lattice[at]); };
        auto of_four = [&](i64 a, i64 b, i64 c, i64 d) {
            return lesser(lesser(apart(a), apart(b)), lesser(apart(c), apart(d)));
        };
        double nearest = least[i];
        auto offer = [&](double square, float apart) { nearest = lesser(nearest, cost(square, weight, apart)); };
        // the first are always tested, because when to stop is unpredictable, and a wrong prediction costs more
        i64 up = home - stride, down = home + stride, top = up - stride, bottom = down + stride;
        offer(0, apart(home));
        offer(1, of_four(home - 1, home + 1, up, down));
        offer(2, of_four(up - 1, up + 1, down - 1, down + 1));
        offer(4, of_four(home - 2, home + 2, top, bottom));
        offer(5, of_four(up - 2, up + 2, down - 2, down + 2));
        offer(5, of_four(top - 1, top + 1, bottom - 1, bottom + 1));
        for (i64 k = UNASKED; k < steps.size() && squares[k] < nearest; k += 4)
            offer(squares[k],
                  of_four(home + steps[k], home + steps[k + 1], home + steps[k + 2], home + steps[k + 3]));
        least[i] = nearest;
        *lonely |= nearest > MARGIN * MARGIN;
    }
}

// Spikes by cells of CELL pixels. Lowers the least costs of other spikes if these are above `settled`.
void search_cells(const Spikes& from, const Spikes& to, i64 height, i64 width, double weight, double settled,
                  Span<double> best) {
    i64 rows = (height + CELL - 1) / CELL, columns = (width + CELL - 1) / CELL;
    Vector<i64> begins(rows * columns + 1), order(to.x.size());
    auto cell_of = [&](i64 j) { return to.y[j] / CELL * columns + to.x[j] / CELL; };
    for (i64 j = 0; j < to.x.size(); ++j) ++begins[cell_of(j) + 1];
    for (i64 cell = 0; cell < rows * columns; ++cell) begins[cell + 1] += begins[cell];
    Vector<i64> next = begins;
    for (i64 j = 0; j < to.x.size(); ++j) order[next[cell_of(j)]++] = j;
    Interrupt interrupt;
    for (i64 i = 0; i < from.x.size(); ++i) {
        if (i % PATIENCE == 0) interrupt.poll();
        if (best[i] <= settled) continue;
        i64 row = from.y[i] / CELL, column = from.x[i] / CELL;
        double least = best[i];
        auto look_into = [&](i64 cell) {
            for (i64 k = begins[cell]; k < begins[cell + 1]; ++k) {
                i64 j = order[k];
                double dx = double(from.x[i] - to.x[j]), dy = double(from.y[i] - to.y[j]);
                double apart = double(i64(u64(from.value[i]) - u64(to.value[j])));
                least = lesser(least, cost(dx * dx + dy * dy, weight, apart));
            }
        };
        for (i64 ring = 0; ring < std::max(rows, columns); ++ring) {
            // everything in this ring of cells is at least this far away
            double gap = double(std::max(ring - 1, i64(0)) * CELL + (ring > 0));
            if (gap * gap >= least) break;
            for (i64 r = std::max(row - ring, i64(0)); r < std::min(row + ring + 1, rows); ++r) {
                i64 left = column - ring, right = column + ring;
                if (r == row - ring || r == row + ring) {
                    for (i64 c = std::max(left, i64(0)); c < std::min(right + 1, columns); ++c)
                        look_into(r * columns + c);
                } else {
                    if (left >= 0) look_into(r * columns + left);
                    if (right < columns) look_into(r * columns + right);
                }
            }
        }
        best[i] = least;
    }
}

}  // namespace

template <class Coordinate, class Sum>
i64 sum_polarity(Span<const Coordinate> x, Span<const Coordinate> y, Span<const u8> p, Rows<Sum> sums,
                 Span<i64> touched) {
    i64 n = x.size(), width = sums.columns(), count = 0;
    require(y.size() == n && p.size() == n && touched.size() >= n, "columns of events differ in length");
    check_below(x, width, "an event is outside the frame");
    check_below(y, sums.rows(), "an event is outside the frame");
    Span<Sum> flat = sums.flat();
    for (i64 i = 0; i < n; ++i) {
        i64 place = y[i] * width + x[i];
        touched[count] = place;
        count += flat[place] == 0;
        flat[place] = Sum(u64(flat[place]) + 2 * u64(p[i]) - 1);
    }
    return count;
}

template <class Sum>
i64 spikes(Rows<Sum> sums, Span<i64> places, Span<i64> x, Span<i64> y, Span<i64> total) {
    require(std::min({x.size(), y.size(), total.size()}) >= places.size(), "there must be room for all spikes");
    check_below(Span<const i64>(places), sums.flat().size(), "a spike is outside the frame");
    std::sort(places.begin(), places.end());
    Span<Sum> flat = sums.flat();
    i64 n = 0, width = sums.columns();
    for (i64 place : places) {
        // places may occur twice
        if (flat[place] == 0) continue;
        x[n] = place % width;
        y[n] = place / width;
        total[n++] = std::exchange(flat[place], 0);
    }
    return n;
}

void nearest(Span<const i64> x, Span<const i64> y, Span<const i64> value, Span<const i64> bx, Span<const i64> by,
             Span<const i64> bvalue, i64 height, i64 width, double weight, double limit, Span<double> least) {
    Spikes from{x, y, value}, to{bx, by, bvalue};
    from.check(height, width);
    to.check(height, width);
    require(least.size() == x.size(), "each spike must have a cost");
    std::fill(least.begin(), least.end(), limit + 1);
    if (double(bx.size()) * SPARSE < double(height) * double(width))
        return search_cells(from, to, height, width, weight, -1, least);
    i64 stride = width + 2 * MARGIN;
    // an empty pixel counts as infinitely far, so that no branch has to test for it, which would be unpredictable
    Vector<float> memory((height + 2 * MARGIN) * stride, std::numeric_limits<float>::infinity());
    Span<float> lattice(memory);
    for (i64 j = 0; j < bx.size(); ++j) lattice[(by[j] + MARGIN) * stride + bx[j] + MARGIN] = float(bvalue[j]);
    // except for the first, there are four at each distance
    static const Vector<Step> around = steps_around(MARGIN, [](i64 square) { return square <= MARGIN * MARGIN; });
    Vector<i64> memory_of_steps(around.size());
    Vector<double> memory_of_squares(around.size());
    Span<i64> steps(memory_of_steps);
    Span<double> squares(memory_of_squares);
    for (i64 k = 0; k < steps.size(); ++k) {
        steps[k] = around[k].dy * stride + around[k].dx;
        squares[k] = double(around[k].square);
    }
    Interrupt interrupt;
    bool lonely = false;
    for (i64 i = 0; i < x.size(); i += PATIENCE) {
        interrupt.poll();
        i64 to = std::min(x.size(), i + PATIENCE);
        best<look_around>(x.part(i, to), y.part(i, to), value.part(i, to), lattice, stride, steps, squares, weight,
                          least.part(i, to), &lonely);
    }
    if (lonely && limit > MARGIN * MARGIN) search_cells(from, to, height, width, weight, MARGIN * MARGIN, least);
}

void cancel(Span<const i64> place_a, Span<i64> a, Span<const i64> place_b, Span<i64> b) {
    require(place_a.size() == a.size() && place_b.size() == b.size(), "places and masses differ in number");
    for (i64 i = 0, j = 0; i < a.size() && j < b.size();) {
        if (place_a[i] < place_b[j]) {
            ++i;
        } else if (place_a[i] > place_b[j]) {
            ++j;
        } else {
            u64 same = u64(std::min(a[i], b[j]));
            a[i] = i64(u64(a[i]) - same);
            b[j] = i64(u64(b[j]) - same);
            ++i, ++j;
        }
    }
}

template <class Sum>
void define_sums(nb::module_& module) {
    define<sum_polarity<i16, Sum>, sum_polarity<i32, Sum>>(module, "sum_polarity");
    define<spikes<Sum>>(module, "spikes");
}

void define_distances(nb::module_& module) {
    define_sums<i32>(module);
    define_sums<i64>(module);
    define<nearest>(module, "nearest");
    define<cancel>(module, "cancel");
}

}  // namespace nvsdata
