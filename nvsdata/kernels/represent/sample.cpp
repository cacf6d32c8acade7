// Non-uniform grid sampling.
#include <vector>

#include "../native/bind.h"
#include "../native/levels.h"
#include "../native/interrupt.h"
#include "../native/random.h"
#include "events.h"

namespace nvsdata {

namespace {

constexpr i64 BUCKETS = 256;  // in the histogram that finds a median

struct Range {
    i32 least, most;
    i64 side() const { return i64(most) - least; }
};

NVSDATA_INLINE Range range_of(const i16* values, i64 count) {
    i16 least = values[0], most = values[0];
    for (i64 i = 1; i < count; ++i) {
        i16 value = values[i];
        least = value < least ? value : least;
        most = value > most ? value : most;
    }
    return {least, most};
}

// A value, and the number of equal values before the place that was searched.
struct Border {
    i32 value;
    i64 equal;
};

// The nth smallest of values, all of which are in the range.
Border median(Span<const i16> values, Range range, i64 nth) {
    std::array<i32, BUCKETS> counts;
    auto [first, last] = range;
    int shift = 0;
    while ((last - first) >> shift >= BUCKETS) ++shift;
    i64 before = 0;
    for (;; shift = 0) {
        u32 most = u32(last - first) >> shift;
        std::fill_n(counts.begin(), most + 1, 0);
        for (i16 value : values) {
            // a value below `first` wraps to a large number
            u32 bucket = u32(value - first) >> shift;
            if (bucket <= most) ++counts[bucket];
        }
        i32 bucket = 0;
        // the loop ends within the range, because the range has more than nth values
        while (before + counts[bucket] <= nth) before += counts[bucket++];
        first += bucket << shift;
        if (shift == 0) return {first, nth - before};
        last = std::min(last, first + (1 << shift) - 1);
    }
}

// Events in boxes, each of which keeps its events in order of time, so that a split in time needs no sorting.
class Sampler {
public:
    Sampler(Span<const i64> t, Span<const i16> x, Span<const i16> y, i64 k, double wx, double wt)
        : t_(t), k_(k), wx_(wx), wt_(wt), index_(t.size()), columns_{{x.begin(), x.end()}, {y.begin(), y.end()}},
          spare_index_(t.size()), spare_x_(t.size()), spare_y_(t.size()) {
        for (std::size_t i = 0; i < index_.size(); ++i) index_[i] = i32(i);
    }

    // Calls chosen(event) for an event of each box.
    template <class Chosen>
    void run(u64 state, Chosen chosen) {
        std::vector<std::pair<i64, i64>> boxes;
        if (!t_.empty()) boxes.emplace_back(0, t_.size());
        Interrupt interrupt;
        i64 done = 0;
        while (!boxes.empty()) {
            auto [low, high] = boxes.back();
            boxes.pop_back();
            i64 count = high - low;
            if ((done += count) > STEPS) interrupt.poll(), done = 0;
            if (count <= k_) {
                state += step;
                // the upper 32 bits, scaled: negligible bias for boxes below 2^20 events
                chosen(index()[low + i64(((random_bits(state) >> 32) * u64(count)) >> 32)]);
                continue;
            }
            i64 middle = low + count / 2;
            split(low, middle, high);
            boxes.emplace_back(middle, high);
            boxes.emplace_back(low, middle);
        }
    }

private:
    Span<const i64> t_;
    i64 k_;
    double wx_, wt_;
    std::vector<i32> index_;
    std::vector<i16> columns_[2];
    std::vector<i32> spare_index_;
    std::vector<i16> spare_x_, spare_y_;

    Span<i32> index() { return index_; }
    Span<i16> column(int axis) { return columns_[axis]; }

    // Moves events to either side of the middle, at the median of the box's widest side.
    void split(i64 low, i64 middle, i64 high) {
        Range x = best<range_of>(&column(0)[low], high - low), y = best<range_of>(&column(1)[low], high - low);
        double side_x = double(x.side()) * wx_, side_y = double(y.side()) * wx_;
        double side_t = double(minus(t_[index()[high - 1]], t_[index()[low]])) * wt_;
        if (!(side_t < side_x || side_t < side_y)) return;
        int axis = side_x >= side_y ? 0 : 1;
        Border border = median(column(axis).part(low, high), axis == 0 ? x : y, middle - low);
        partition(low, high, axis, border);
    }

    // Moves events below the border, and the first of those at it, to the front, stably.
    void partition(i64 low, i64 high, int axis, Border border) {
        Span<i32> index = this->index();
        Span<i16> x = column(axis), y = column(1 - axis);
        Span<i32> far_index(spare_index_);
        Span<i16> far_x(spare_x_), far_y(spare_y_);
        i64 left = low, right = 0;
        for (i64 i = low; i < high; ++i) {
            i32 event = index[i];
            i16 at = x[i], other = y[i];
            bool tie = (at == border.value) & (border.equal > 0);
            border.equal -= tie;
            bool near = (at < border.value) | tie;
            // without a branch: both places are written, and only the counts depend on the comparison
            far_index[right] = event, far_x[right] = at, far_y[right] = other;
            index[left] = event, x[left] = at, y[left] = other;
            left += near;
            right += !near;
        }
        std::copy_n(far_index.begin(), right, index.begin() + left);
        std::copy_n(far_x.begin(), right, x.begin() + left);
        std::copy_n(far_y.begin(), right, y.begin() + left);
    }
};

void nonuniform_sample(Span<const i64> t, Span<const i16> x, Span<const i16> y, i64 k, double wx, double wt, u64 seed,
                       Span<bool> chosen) {
    require_columns(t.size(), {x, y});
    require_shapes(chosen.size() == t.size());
    require(k >= 1, "a box must hold an event");
    require(t.size() <= std::numeric_limits<i32>::max(), "at most 2^31 - 1 events can be sampled");
    Sampler(t, x, y, k, wx, wt).run(seed, [&](i64 event) { chosen[event] = true; });
}

}  // namespace

void define_sample(nb::module_& module) { define<nonuniform_sample>(module, "nonuniform_sample"); }

}  // namespace nvsdata
