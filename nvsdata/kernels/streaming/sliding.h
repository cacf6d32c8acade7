// The graph of the events in a sliding window, and the first graph that is pooled from it.
#pragma once

#include <memory>

#include "../graph/neighbors.h"
#include "../native/interrupt.h"
#include "cells.h"
#include "window.h"

namespace nvsdata::streaming {

// Updates of a graph of events when events leave and arrive.
class SlidingGraph {
public:
    Window window;
    Cells cells;
    Marks dirty;  // rows of events whose neighbors changed, including some events that left

    SlidingGraph(std::shared_ptr<const Metric> metric, Window&& empty, Cells&& pooled)
        : window(std::move(empty)), cells(std::move(pooled)), dirty(window.capacity()), metric_(std::move(metric)),
          near_(window.pixels.size()) {}

    // Remove the events before time `until`, and append others, which must fit into the arrays and be no earlier.
    void slide(i64 until, Span<const i64> t, Span<const i16> x, Span<const i16> y, Interrupt& interrupt) {
        unsigned steps = 0;
        auto poll = [&] {
            if (++steps % 256 == 0) interrupt.poll();
        };
        for (; window.size() && window.t[window.row_of(window.first)] < until; poll()) leave();
        i64 first = window.first;
        for (i64 pixel : near_.numbers()) {
            poll();
            const Window::Pixel& here = window.pixels[pixel];
            // other events of the pixel have k nearer ones there
            for (i64 n = 0; n < std::min(i64(here.size), window.k); ++n) {
                i64 number = window.slots[here.begin + n];
                if (has_lost(window.row_of(number), first)) forget(number);
            }
        }
        near_.clear();
        if (window.size() == 0) {
            fill(t, x, y, poll);
        } else {
            for (i64 n = 0; n < t.size(); ++n, poll()) {
                window.push(t[n], x[n], y[n]);
                arrive(window.next - 1);
            }
        }
        cells.collect_changes();
    }

    void grow(i64 capacity) {
        cells.grow(capacity, window.oldest(), window.next);
        window.grow(capacity);
        dirty = Marks(capacity);
    }

    i64 cell_of(i64 row) const { return cells.grid.cell_of(window.x[row], window.y[row]); }

private:
    std::shared_ptr<const Metric> metric_;
    Marks near_;  // pixels near events that left
    // Append events to an empty window. Finding all neighbors at once is faster than for one event after the other.
    template <class Poll>
    void fill(Span<const i64> t, Span<const i16> x, Span<const i16> y, Poll poll) {
        i64 n = t.size(), first = window.next, k = std::max(std::min(window.k, n - 1), i64(1));
        std::vector<i32> degree(n), sources(n * (k + 1));
        Rows<i32> source(sources.data(), n, k + 1);
        near_sources(t, x, y, metric_->radius, metric_->alpha, metric_->beta, SWEEP, Span<i32>(degree), source);
        for (i64 i = 0; i < n; ++i) window.push(t[i], x[i], y[i]);
        for (i64 i = 0; i < n; ++i, poll()) {
            i64 row = window.row_of(first + i);
            window.degree[row] = degree[i];
            for (i64 m = 0; m < degree[i]; ++m) {
                i64 j = source(i, m), dx = x[j] - x[i], dy = y[j] - y[i];
                double gap = double(std::abs(t[j] - t[i]));
                window.source(row, m) = first + j;
                window.far(row, m) = metric_->alpha * double(dx * dx + dy * dy) + metric_->beta * (gap * gap);
            }
            window.find_farthest(row);
            cells.add_member(cell_of(row), first + i, window.place(row));
            dirty.mark(row);
            count_own(row, 1);
        }
    }

    // Remove the oldest event and its edges, and mark the pixels near it.
    void leave() {
        i64 row = window.row_of(window.first), home = cell_of(row);
        count_own(row, -1);
        cells.remove_member(home, window.first, window.place(row));
        cells.rescan.mark(home);
        window.pop();
        i64 x = window.x[row], y = window.y[row];
        for (const Metric::Offset& offset : metric_->offsets)
            if (window.is_inside(x + offset.x, y + offset.y)) near_.mark((y + offset.y) * window.width + x + offset.x);
    }

    // Remove the neighbors of an event that left the window, and find others in their place.
    void forget(i64 number) {
        i64 row = window.row_of(number), home = cell_of(row);
        dirty.mark(row);
        i32 degree = window.degree[row], kept = 0;
        if (degree == window.k) {
            // there may be others that were too far to be among the k nearest
            count_own(row, -1);
            window.search(number, *metric_);
            count_own(row, 1);
            return;
        }
        for (i32 n = 0; n < degree; ++n) {
            i64 source = window.source(row, n);
            if (source < window.first) {
                cells.count_edge(home, cell_of(window.row_of(source)), -1);
                continue;
            }
            window.source(row, kept) = source, window.far(row, kept) = window.far(row, n);
            ++kept;
        }
        window.degree[row] = kept;
        window.find_farthest(row);
    }

    // Whether an event's neighbors have numbers below `first`.
    bool has_lost(i64 row, i64 first) const {
        bool lost = false;
        const i64* source = window.source[row].data();
        for (i32 n = 0, degree = window.degree[row]; n < degree; ++n) lost |= source[n] < first;
        return lost;
    }

    // Find the neighbors of an event that arrived, and the events whose neighbor it becomes.
    void arrive(i64 number) {
        i64 row = window.row_of(number), home = cell_of(row), k = window.k;
        cells.add_member(home, number, window.place(row));
        window.search(number, *metric_);
        count_own(row, 1);
        dirty.mark(row);
        i64 x = window.x[row], y = window.y[row];
        bool is_own = true;  // the first offset's pixel
        for (const Metric::Offset& offset : metric_->offsets) {
            i64 u = x + offset.x, v = y + offset.y, own = std::exchange(is_own, false);
            if (!window.is_inside(u, v)) continue;
            const Window::Pixel& pixel = window.pixels[v * window.width + u];
            // other events of the pixel have k nearer ones there
            for (i64 slot = pixel.end() - 1; slot >= std::max(pixel.end() - k - own, i64(pixel.begin)); --slot) {
                i64 other = window.slots[slot], at = window.row_of(other);
                bool is_full = window.degree[at] == k;
                if (other == number || (is_full && offset.apart > window.far(at, window.worst[at]))) continue;
                i64 last = is_full ? window.row_of(window.source(at, window.worst[at])) : 0;
                if (!window.offer(at, number, offset.apart, *metric_)) continue;
                if (is_full) cells.count_edge(cell_of(at), cell_of(last), -1);
                cells.count_edge(cell_of(at), home, 1);
                dirty.mark(at);
            }
        }
    }

    // Add or remove the edges to an event.
    void count_own(i64 row, int way) {
        i64 home = cell_of(row);
        for (i32 n = 0; n < window.degree[row]; ++n)
            cells.count_edge(home, cell_of(window.row_of(window.source(row, n))), way);
    }
};

}  // namespace nvsdata::streaming
