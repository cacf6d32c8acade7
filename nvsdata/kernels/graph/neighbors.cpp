// The nearest events of each event, in space and time.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "../native/bind.h"
#include "../native/bits.h"
#include "../native/interrupt.h"
#include "../native/require.h"
#include "../native/vector.h"
#include "../native/wrap.h"
#include "neighbors.h"
#include "pixels.h"

namespace nvsdata {

constexpr i64 OFTEN = 256;          // events between two polls for Ctrl-C
constexpr i64 CHUNK = 4096;         // pairs that are near in time and space and tested together
constexpr double ROUNDING = 1e-12;  // by which a rounded bound is exceeded in a search

// Squared distance: alpha (dx² + dy²) + beta dt².
struct Metric {
    double radius, alpha, beta;
    i64 k;
    double limit() const { return radius * radius; }
    // Squared distance that the largest difference in time adds. It is rounded like a distance, because at exactly the
    // radius the last bit decides.
    double most_in_time(Span<const i64> t) const {
        double span = t.empty() ? 0 : double(minus(t.back(), t[0]));
        return beta * (span * span);
    }
};

// Sources of each event, at most k and ascending: their number, and a row of indices with room for one more.
struct Sources {
    Span<i32> degree;
    Rows<i32> source;
    i32* of(i64 i) const { return source[i].data(); }
};

namespace {

struct Candidate {
    double d;
    i64 dt;
    i32 event;
    bool operator<(const Candidate& other) const {
        if (d != other.d) return d < other.d;
        return dt != other.dt ? dt < other.dt : event < other.event;
    }
};

// The k nearest of the offered candidates.
class Nearest {
public:
    explicit Nearest(i64 k) : found_(std::size_t(k)) {}
    void clear() { count_ = 0; }
    bool full() const { return count_ == found_.size(); }
    const Candidate& worst() const { return found_[worst_]; }
    bool offer(const Candidate& candidate) {
        if (full()) {
            if (!(candidate < worst())) return false;
            found_[worst_] = candidate;
        } else {
            found_[count_++] = candidate;
        }
        if (full()) find_worst();
        return true;
    }
    // Calls each(event) for the kept candidates.
    template <class Each>
    void each_event(Each each) const {
        for (std::size_t n = 0; n < count_; ++n) each(found_[n].event);
    }

private:
    Vector<Candidate> found_;
    std::size_t count_ = 0, worst_ = 0;

    void find_worst() {
        const Candidate* furthest = found_.data();
        for (const Candidate& other : found_)
            if (*furthest < other) furthest = &other;
        worst_ = std::size_t(furthest - found_.data());
    }
};

// Sets of events of two kinds, which are returned in order.
class Marks {
public:
    explicit Marks(std::size_t n) : words_(2 * ((n >> 6) + 1)), used_((n >> 12) + 1) {}
    void mark(i32 event, int kind) {
        std::size_t word = std::size_t(event) >> 6;
        words_[2 * word + kind] |= u64(1) << (event & 63);
        used_[word >> 6] |= u64(1) << (word & 63);
    }
    // calls `each(event, kind)` for all events in order, and removes them
    template <class Each>
    void drain(Each each) {
        for (std::size_t group = 0; group < used_.size(); ++group) {
            for (u64 words = std::exchange(used_[group], 0); words; words &= words - 1) {
                std::size_t word = group << 6 | trailing_zeros(words);
                u64 last = std::exchange(words_[2 * word + 1], 0);
                for (u64 bits = std::exchange(words_[2 * word], 0) | last; bits; bits &= bits - 1) {
                    int bit = trailing_zeros(bits);
                    each(i32(word << 6 | bit), last >> bit & 1);
                }
            }
        }
    }

private:
    Vector<u64> words_, used_;
};

class Search {
public:
    Search(Span<const i64> t, PixelLists&& pixels, const Metric& metric, const Sources& sources, Interrupt& interrupt)
        : t_(t), pixels_(std::move(pixels)), metric_(metric), sources_(sources), marks_(t.size()), nearest_(metric.k),
          whole_room_(std::size_t(t.size()) + 1), last_room_(whole_room_.size()), interrupt_(interrupt) {}

    void run() {
        double alpha = metric_.alpha, limit = metric_.limit();
        slack_ = metric_.most_in_time(t_);
        i64 furthest = 0, blur = 0;
        if (alpha > 0) {
            furthest = i64(std::min(std::floor(limit / alpha * (1 + ROUNDING)), double(FAR)));
            blur = i64(std::min(std::floor(slack_ / alpha * (1 + ROUNDING)), double(FAR)));
        }
        Offsets offsets(std::min(furthest, LISTED * LISTED), pixels_.columns);
        for (i32 pixel = 0; pixel < i32(pixels_.size()); ++pixel) {
            i64 total = pixels_.near(pixel, metric_.k + 1, furthest, blur, offsets, near_);
            bool sure = true;
            if (alpha * double(near_.back().apart) + slack_ > limit) sure = keep_near_in_time(pixel, total);
            if (sure && (blur == 0 || total <= metric_.k + 1))
                by_rings(pixel, total);
            else
                one_by_one(pixel);
        }
    }

private:
    Span<const i64> t_;
    PixelLists pixels_;
    const Metric& metric_;
    Sources sources_;
    Marks marks_;
    Nearest nearest_;
    double slack_ = 0;  // squared distance that the largest difference in time adds
    Vector<Near> near_;
    Vector<i32> whole_room_, last_room_, place_;
    Span<const i32> whole_, last_;  // events of complete rings, and of the last one
    Interrupt& interrupt_;
    unsigned steps_ = 0;

    // Check for Ctrl-C once in OFTEN calls.
    void poll() {
        if (++steps_ % OFTEN == 0) interrupt_.poll();
    }

    const i32* begin(i32 pixel) const { return pixels_.order.data() + pixels_.first[pixel]; }
    const i32* end(i32 pixel) const { return pixels_.order.data() + pixels_.first[pixel + 1]; }

    // Keep the near pixels with an event that is also near in time; return whether all of their events are.
    bool keep_near_in_time(i32 pixel, i64& total) {
        double alpha = metric_.alpha, limit = metric_.limit();
        bool sure = true;
        auto far = std::remove_if(near_.begin(), near_.end(), [&](const Near& other) {
            if (alpha * double(other.apart) + slack_ <= limit) return false;
            double left = limit - alpha * double(other.apart);
            double dt = std::sqrt((left + limit * ROUNDING) / metric_.beta) + 1;
            bool none = left < 0 || !any_within(dt, pixel, other.pixel);
            if (none) total -= pixels_.events(other.pixel);
            sure = sure && none;
            return none;
        });
        near_.erase(far, near_.end());
        return sure;
    }

    // Whether an event of one pixel and an event of the other are at most `dt` µs apart.
    bool any_within(double dt, i32 a, i32 b) const {
        for (auto i = begin(a), j = begin(b); i != end(a) && j != end(b);) {
            if (double(gap(t_[*i], t_[*j])) <= dt) return true;
            t_[*i] < t_[*j] ? ++i : ++j;
        }
        return false;
    }

    // If no difference in time can change the order of distances in space, and all events are near enough in time:
    // complete rings of pixels are sources of all events of the pixel. Of the last ring, each event takes those nearest
    // in time.
    void by_rings(i32 pixel, i64 total) {
        i64 k = metric_.k, left = 0;
        std::size_t q = near_.size();
        if (total > k + 1) {
            left = k + 1 - total;
            for (i64 ring = near_.back().apart; q && near_[q - 1].apart == ring; --q)
                left += pixels_.events(near_[q - 1].pixel);
        }
        for (std::size_t p = 0; p < near_.size(); ++p)
            for (auto e = begin(near_[p].pixel); e != end(near_[p].pixel); ++e) marks_.mark(*e, p >= q);
        i64 wholes = 0, lasts = 0;
        // no branch, because it is unpredictable which events are in the last ring
        marks_.drain([&](i32 event, bool last) {
            whole_room_[wholes] = last_room_[lasts] = event;
            wholes += !last, lasts += last;
        });
        whole_ = {whole_room_.data(), wholes}, last_ = {last_room_.data(), lasts};
        bool own = q == 0;
        std::size_t from = 0;
        for (auto e = begin(pixel); e != end(pixel); ++e) {
            poll();
            i32* out = sources_.of(*e);
            i32* first = out;
            if (left == 0) {
                for (i32 event : whole_) {
                    *out = event;
                    out += event != *e;
                }
            } else {
                out = merged(nearest_in_time(*e, left, own, from), *e, out);
            }
            sources_.degree[*e] = i32(out - first);
        }
    }
    struct Runs {
        std::size_t a, b, c, d;  // events of last_: from a up to b, and from c up to d
    };

    // The `left` events of the last ring that are nearest to event i in time. They are adjacent, except that of equally
    // near events the ones of smallest index are taken. `from` only moves forward.
    Runs nearest_in_time(i32 i, i64 left, bool own, std::size_t& from) const {
        std::size_t some = std::min(std::size_t(left), std::size_t(last_.size()));
        auto time = [&](std::size_t n) { return t_[last_[n]]; };
        while (from + some < std::size_t(last_.size())) {
            i64 later = time(from + some), earlier = time(from);
            if (later != earlier && gap(later, t_[i]) >= gap(earlier, t_[i])) break;
            ++from;
        }
        std::size_t stop = from + some;
        if (some == 0 || ((from == 0 || time(from - 1) != time(from)) && !own)) return {from, stop, stop, stop};
        // only the first chosen events may have events of the same time before them
        auto at = [&](std::size_t lo, std::size_t hi, i64 value) {
            auto found = std::lower_bound(last_.begin() + lo, last_.begin() + hi, value,
                                          [&](i32 j, i64 v) { return t_[j] < v; });
            return std::size_t(found - last_.begin());
        };
        i64 equal = time(from);
        std::size_t begin = at(0, from, equal), end = at(from, stop, equal + 1), count = end - from;
        if (own && equal == t_[i]) {
            // one of them is i itself, or takes its place
            std::size_t others = count - 1;
            count = others + (others > 0 && last_[begin + others - 1] >= i);
        }
        return {count ? begin : end, (count ? begin : end) + count, end, stop};
    }

    // Events of complete rings and the chosen ones of the last ring, without event i, ascending.
    i32* merged(Runs runs, i32 i, i32* out) const {
        auto whole = whole_.begin();
        auto put = [&](i32 event) {
            *out = event;
            out += event != i;
        };
        for (auto [from, to] : {std::pair(runs.a, runs.b), std::pair(runs.c, runs.d)})
            for (std::size_t n = from; n < to; ++n) {
                for (; whole != whole_.end() && *whole < last_[n]; ++whole) put(*whole);
                put(last_[n]);
            }
        for (; whole != whole_.end(); ++whole) put(*whole);
        return out;
    }

    // Sources of a pixel's events where distances in space and time add up: pixel by pixel, outward in time.
    void one_by_one(i32 pixel) {
        place_.clear();
        for (const Near& other : near_) place_.push_back(pixels_.first[other.pixel]);
        for (auto e = begin(pixel); e != end(pixel); ++e) {
            poll();
            nearest_.clear();
            for (std::size_t q = 0; q < near_.size(); ++q) {
                double base = metric_.alpha * double(near_[q].apart);
                i32 stop = pixels_.first[near_[q].pixel + 1];
                while (place_[q] < stop && pixels_.order[place_[q]] < *e) ++place_[q];
                if (nearest_.full() && base > nearest_.worst().d) break;
                outward(*e, base, begin(near_[q].pixel), pixels_.order.data() + place_[q], end(near_[q].pixel));
            }
            list_nearest(*e);
        }
    }

    // List the nearest events of event i, ascending.
    void list_nearest(i32 i) {
        i32 *out = sources_.of(i), *first = out;
        nearest_.each_event([&](i32 event) { marks_.mark(event, 0); });
        marks_.drain([&](i32 event, bool) { *out++ = event; });
        sources_.degree[i] = i32(out - first);
    }

    // Offer the events of a pixel, nearest in time first, as long as they are near enough. `later` is the first event
    // that is not before event i. Of equal times, smaller indices come first.
    void outward(i32 i, double base, const i32* first, const i32* later, const i32* end) {
        auto offer = [&](i32 j) {
            i64 dt = gap(t_[j], t_[i]);
            double d = base + metric_.beta * (double(dt) * double(dt));
            return d <= metric_.limit() && nearest_.offer({d, dt, j});
        };
        const i32* after = later + (later != end && *later == i);
        // earlier events by runs of equal times: the next one, where its run ends, and where it begins
        const i32 *before = later, *until = later, *run = later;
        auto next_run = [&] {
            before = until = run;
            if (run == first) return;
            run = before -= 1;
            if (run != first && t_[run[-1]] == t_[*run])
                before = run = std::lower_bound(first, run, t_[*run], [&](i32 j, i64 v) { return t_[j] < v; });
        };
        next_run();
        for (bool ahead = after != end, behind = before != until; ahead || behind;) {
            if (ahead && (!behind || gap(t_[*after], t_[i]) <= gap(t_[*before], t_[i]))) {
                ahead = offer(*after) && ++after != end;
            } else {
                behind = offer(*before);
                if (behind && ++before == until) {
                    next_run();
                    behind = before != until;
                }
            }
        }
    }
};

// Pairs of events that are near in time.
struct Pairs {
    i64 all = 0, most = 0;  // number of pairs; largest number of earlier events of an event
};

// Pairs of events at most `reach` µs apart. O(N).
Pairs pairs_in_time(Span<const i64> t, i64 reach) {
    Pairs pairs;
    i64 first = 0;
    for (i64 i = 0; i < t.size(); ++i) {
        while (minus(t[i], t[first]) > reach) ++first;
        pairs.all += i - first;
        pairs.most = std::max(pairs.most, i - first);
    }
    return pairs;
}

// Sort a few values, most of which are in order.
void ascend(i32* values, i64 count) {
    for (i64 n = 1; n < count; ++n) {
        i32 value = values[n];
        i64 at = n;
        for (; at > 0 && values[at - 1] > value; --at) values[at] = values[at - 1];
        values[at] = value;
    }
}

// Pairs that are near in time, from each event backward; fills the lists of both events. O(N + pairs in time).
template <class Coordinate>
void sweep(Span<const i64> t, Span<const Coordinate> x, Span<const Coordinate> y, const Metric& metric, i64 reach,
           const Pairs& near, const Sources& sources, Interrupt& interrupt) {
    i64 n = t.size(), k = metric.k;
    double limit = metric.limit();
    auto distance = [&](i64 i, i64 j) {
        i64 dx = i64(x[i]) - x[j], dy = i64(y[i]) - y[j];
        double dt = double(minus(t[i], t[j]));
        return metric.alpha * double(dx * dx + dy * dy) + metric.beta * (dt * dt);
    };
    auto candidate = [&](i64 i, i64 j) { return Candidate{distance(i, j), gap(t[j], t[i]), i32(j)}; };
    Vector<i32> worst(static_cast<std::size_t>(n));
    auto find_worst = [&](i64 i) {
        const i32* row = sources.of(i);
        i32 found = 0;
        Candidate furthest = candidate(i, row[0]);
        for (i32 other = 1; other < k; ++other)
            if (Candidate next = candidate(i, row[other]); furthest < next) found = other, furthest = next;
        worst[i] = found;
    };
    auto insert = [&](i64 i, i64 j) {
        i32& have = sources.degree[i];
        i32* row = sources.of(i);
        if (have < k) {
            row[have++] = i32(j);
            if (have == k) find_worst(i);
        } else if (candidate(i, j) < candidate(i, row[worst[i]])) {
            row[worst[i]] = i32(j);
            find_worst(i);
        }
    };
    // row and column in one number; a sum, because then differences are exact whatever the coordinates, modulo 2^32
    Vector<u32> place(static_cast<std::size_t>(n));
    for (i64 i = 0; i < n; ++i) place[i] = (u32(y[i]) << 16) + u32(x[i]);
    // if no bit outside is set, both differences are in 0..2 side, or in the next power of two
    double side = std::floor(std::sqrt(limit / metric.alpha)) + 1;
    u32 wide = 1;
    while (wide < u32(2 * side + 1)) wide *= 2;
    u32 outside = ~((wide - 1) * 0x10001u), margin = u32(side) * 0x10001u;
    // the later event in the upper half, the earlier one in the lower, because storing pairs takes most of the time
    Vector<u64> pairs(std::size_t(std::min(CHUNK, near.all) + near.most + 1));
    for (i64 i = 0, first = 0; i < n;) {
        i64 found = 0, kept = 0;
        interrupt.poll();
        for (i64 stop = std::min(n, i + CHUNK); i < stop && found < CHUNK; ++i) {
            while (minus(t[i], t[first]) > reach) ++first;
            u32 corner = place[i] - margin;
            u64 later = u64(i) << 32;
            // no branch, because it is unpredictable which events are near
            for (i64 j = first; j < i; ++j) {
                pairs[found] = later | u64(j);
                found += ((place[j] - corner) & outside) == 0;
            }
        }
        for (i64 q = 0; q < found; ++q) {
            u64 pair = pairs[kept] = pairs[q];
            kept += distance(i64(pair >> 32), i64(u32(pair))) <= limit;
        }
        for (i64 q = 0; q < kept; ++q) {
            i64 later = i64(pairs[q] >> 32), earlier = i64(u32(pairs[q]));
            insert(later, earlier);
            insert(earlier, later);
        }
    }
    for (i64 i = 0; i < n; ++i) ascend(sources.of(i), sources.degree[i]);
}

// Differences of 32-bit coordinates must be so small that sums of their squares don't overflow.
template <class Coordinate>
void check_extent(Span<const Coordinate> values) {
    if constexpr (sizeof(Coordinate) > sizeof(i16)) {
        auto [least, most] = std::minmax_element(values.begin(), values.end());
        require(i64(*most) - *least < 1 << 19, "pixels must be less than 524,288 apart");
    }
}

}  // namespace

template <class Coordinate>
i64 near_sources(Span<const i64> t, Span<const Coordinate> x, Span<const Coordinate> y, double radius, double alpha,
                 double beta, i64 sweep_below, Span<i32> degree, Rows<i32> source) {
    i64 n = t.size();
    require(x.size() == n && y.size() == n && degree.size() == n && source.rows() == n,
            "columns, degrees and rows of sources must be as many as events");
    if (n == 0) return 0;
    require(source.columns() >= 2, "there must be room for a source and one more");
    check_extent(x), check_extent(y);
    if (n == 1) return degree[0] = 0;
    Interrupt interrupt;
    Metric metric{radius, alpha, beta, source.columns() - 1};
    Sources sources{degree, source};
    double limit = metric.limit();
    bool swept = false;
    if (alpha > 0 && beta > 0 && limit / beta < 1e36 && limit / alpha < 1e8) {
        i64 reach = i64(std::sqrt(limit / beta * (1 + ROUNDING))) + 1;
        Pairs pairs = pairs_in_time(t, reach);
        double factor = metric.most_in_time(t) >= alpha ? double(MIXED) : 1;
        swept = double(pairs.all) <= factor * double(sweep_below) * double(n);
        if (swept) sweep(t, x, y, metric, reach, pairs, sources, interrupt);
    }
    if (!swept) Search(t, PixelLists(x, y, alpha > 0), metric, sources, interrupt).run();
    return std::accumulate(degree.begin(), degree.end(), i64(0));
}

template i64 near_sources<i16>(Span<const i64>, Span<const i16>, Span<const i16>, double, double, double, i64,
                               Span<i32>, Rows<i32>);

void define_neighbors(nb::module_& module) {
    module.attr("SWEEP") = SWEEP;
    define<near_sources<i16>, near_sources<i32>>(module, "near_sources");
}

}  // namespace nvsdata
