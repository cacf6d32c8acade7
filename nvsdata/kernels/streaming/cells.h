// Pooled graphs that are updated when the graph below changes: the clusters of `kernels.graph.pool`.
//
// A cluster is a cell of a grid, whose number is that of its node. Sums of positions and numbers of edges are integers,
// so that members and edges can be removed exactly. A step marks the nodes and edges that it touches; then `collect_changes`
// finds those that differ from before.
#pragma once

#include <algorithm>

#include "../native/wrap.h"
#include "columns.h"

namespace nvsdata::streaming {

// Clusters of pixels; positions beyond the grid belong to its border.
struct Grid {
    i64 width, height;  // size of a cell in pixels
    i64 columns, rows;

    // The smallest grid that covers the sensor.
    static Grid of(i64 sensor_width, i64 sensor_height, i64 width, i64 height) {
        return {width, height, (sensor_width - 1) / width + 1, (sensor_height - 1) / height + 1};
    }
    i64 size() const { return columns * rows; }
    i64 cell_of(i64 x, i64 y) const {
        return std::min(y / height, rows - 1) * columns + std::min(x / width, columns - 1);
    }
};

class Cells {
public:
    Grid grid;
    i64 across, down;  // largest distance between the ends of an edge, in cells
    bool has_time;     // otherwise times of places stay 0, because they would change with each event
    i64 offsets;       // number of cells around a cell in which the source of an edge may be
    Column<i64> members;       // number of nodes below
    Column<Place> place, was;  // places of the nodes now (undefined without members), and before they `moved`
    Column<u8> alive;          // whether there was a node when the last step had collected its changes
    Table<u8> edge;            // by target and offset
    Column<i64> home;          // the cell in the graph above, or -1
    Column<i64> head, after;   // the first member of a cell, and by number of the node below, the next member, or -1
    Marks moved, turned;       // cells; edges, as cell * offsets + offset
    Marks rescan;              // cells that lost or gained a member whose features may be the maximum

    // `far_x`, `far_y`: largest distance in pixels of nodes with an edge; `below`: number of nodes of the graph below.
    Cells(Grid cells, i64 far_x, i64 far_y, i64 below, bool with_time)
        : grid(cells), across(std::min((far_x + grid.width - 1) / grid.width, grid.columns - 1)),
          down(std::min((far_y + grid.height - 1) / grid.height, grid.rows - 1)), has_time(with_time),
          offsets((2 * across + 1) * (2 * down + 1)), members(grid.size()), place(grid.size()), was(grid.size()),
          alive(grid.size()), edge(grid.size(), offsets), home(grid.size()), head(grid.size()), after(below),
          moved(grid.size()), turned(grid.size() * offsets), rescan(grid.size()), sums_(grid.size()),
          count_(grid.size(), offsets), previous_(below), touched_(grid.size()), counted_(grid.size() * offsets) {
        home.fill(-1);
        head.fill(-1);
    }

    // A graph that is pooled from this one.
    Cells pooled(Grid cells) const {
        i64 far_x = across * grid.width + grid.width - 1, far_y = down * grid.height + grid.height - 1;
        return {cells, far_x, far_y, grid.size(), has_time};
    }

    // Call `each(offset, cell)` for the cells around a cell, including it.
    template <class Each>
    void around(i64 cell, Each each) const {
        i64 x = cell % grid.columns, y = cell / grid.columns, offset = 0;
        for (i64 v = y - down; v <= y + down; ++v)
            for (i64 u = x - across; u <= x + across; ++u, ++offset)
                if (u >= 0 && u < grid.columns && v >= 0 && v < grid.rows) each(offset, v * grid.columns + u);
    }
    // The cell at an offset, which must be that of an edge.
    i64 neighbor(i64 cell, i64 offset) const {
        i64 wide = 2 * across + 1;
        return cell + (offset / wide - down) * grid.columns + offset % wide - across;
    }
    // Row of a node below. Numbers of events keep growing, so rows are a ring buffer whose size is a power of two.
    i64 row_of(i64 node) const {
        i64 rows = after.size();
        return rows & (rows - 1) ? node : node & (rows - 1);
    }
    // The offset of the same edge in the opposite direction.
    i64 opposite(i64 offset) const { return offsets - 1 - offset; }

    // Add a node below to a cell.
    void add_member(i64 cell, i64 node, const Place& at) {
        ++members[cell];
        add(cell, at, 1);
        i64 first = head[cell];
        after[row_of(node)] = first;
        previous_[row_of(node)] = -1;
        if (first >= 0) previous_[row_of(first)] = node;
        head[cell] = node;
        touched_.mark(cell);
    }

    // Remove a node below from a cell.
    void remove_member(i64 cell, i64 node, const Place& at) {
        --members[cell];
        add(cell, at, u64(-1));
        i64 next = after[row_of(node)], before = previous_[row_of(node)];
        (before >= 0 ? after[row_of(before)] : head[cell]) = next;
        if (next >= 0) previous_[row_of(next)] = before;
        touched_.mark(cell);
    }

    // Add or remove an edge below, from a node of cell `source` to one of cell `target`.
    void count_edge(i64 target, i64 source, int way) {
        if (source == target) return;
        i64 dx = source % grid.columns - target % grid.columns, dy = source / grid.columns - target / grid.columns;
        i64 offset = (dy + down) * (2 * across + 1) + dx + across;
        count_(target, offset) += u32(way);
        counted_.mark(target * offsets + offset);
    }

    // Find the nodes that moved, arrived or left, and the edges that are new or removed. O(touched nodes and edges).
    void collect_changes() {
        for (i64 cell : touched_.numbers()) {
            was[cell] = place[cell];
            bool exists = members[cell] > 0, same = exists == bool(alive[cell]);
            if (exists) {
                place[cell] = mean(cell);
                same = same && place[cell] == was[cell];
            }
            if (!same && (alive[cell] || exists)) moved.mark(cell);
        }
        touched_.clear();
        for (i64 number : counted_.numbers()) {
            i64 target = number / offsets, offset = number % offsets;
            bool now = count_(target, offset) > 0;
            if (now == bool(edge(target, offset))) continue;
            edge(target, offset) = now;
            turned.mark(number);
        }
        counted_.clear();
    }

    // Propagate the changes of this graph to the graph above, and collect the changes there.
    void propagate(Cells& above) {
        for (i64 number : turned.numbers()) {
            i64 target = number / offsets, offset = number % offsets, source = neighbor(target, offset);
            if (home[target] >= 0 && home[source] >= 0)
                above.count_edge(home[target], home[source], edge(target, offset) ? 1 : -1);
        }
        for (i64 cell : moved.numbers()) {
            i64 old = home[cell], now = members[cell] ? above.grid.cell_of(place[cell].x, place[cell].y) : -1;
            if (old >= 0) above.remove_member(old, cell, was[cell]);
            if (now >= 0) above.add_member(now, cell, place[cell]);
            if (now == old) continue;
            if (old >= 0) {
                count_all(above, cell, -1);
                above.rescan.mark(old);
            }
            home[cell] = now;
            if (now >= 0) {
                count_all(above, cell, 1);
                above.rescan.mark(now);
            }
        }
        above.collect_changes();
    }

    // Clear the marks of changes, once all layers are up to date.
    void clear_marks() {
        for (i64 cell : moved.numbers()) alive[cell] = members[cell] > 0;
        moved.clear();
        turned.clear();
    }

    // Grow the arrays for more events below, with numbers from `first` up to `next`.
    void grow(i64 capacity, i64 first, i64 next) {
        widen(after, capacity, first, next);
        widen(previous_, capacity, first, next);
    }

private:
    struct Sums {
        u64 x = 0, y = 0, t = 0;
    };
    Column<Sums> sums_;      // sums of the places of the members
    Table<u32> count_;       // edges below, by target and offset
    Column<i64> previous_;   // see `after`
    Marks touched_, counted_;  // cells; edges

    void add(i64 cell, const Place& at, u64 way) {
        Sums& sums = sums_[cell];
        sums.x += way * u64(at.x), sums.y += way * u64(at.y), sums.t += way * u64(at.t);
    }
    Place mean(i64 cell) const {
        const Sums& sums = sums_[cell];
        i64 n = members[cell];
        // rounded down, times before the first event, too
        return {i64(sums.x) / n, i64(sums.y) / n, has_time ? floor_divide(i64(sums.t), n) : 0};
    }

    // Add or remove all edges of a node in the graph above.
    void count_all(Cells& above, i64 cell, int way) const {
        around(cell, [&](i64 offset, i64 other) {
            if (home[other] < 0) return;
            if (edge(cell, offset)) above.count_edge(home[cell], home[other], way);
            if (edge(other, opposite(offset))) above.count_edge(home[other], home[cell], way);
        });
    }
};

}  // namespace nvsdata::streaming
