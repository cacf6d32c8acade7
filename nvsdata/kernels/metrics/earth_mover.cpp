// Moving mass between points at least cost: the transportation problem, by the network simplex method.
//
// Sources and sinks are the nodes of a spanning tree with an artificial root. Each pivot adds one arc to the tree and
// removes one. Integer masses are often degenerate, so the tree is kept strongly feasible (Cunningham 1976), which
// rules out cycling.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "../native/bind.h"
#include "../native/interrupt.h"
#include "../native/levels.h"
#include "../native/require.h"
#include "../native/vector.h"

namespace nvsdata {

namespace {

constexpr double TOLERANCE = 1e-11;  // reduced costs below it would gain only rounding errors
constexpr i64 MOST = i64(1) << 62;   // bound of the sum of all masses
constexpr i64 LANES = 8;
constexpr i64 PATIENCE = 64;  // searches between two polls for Ctrl-C

struct Points {
    Span<const double> x, y;
    Span<const i64> mass;

    i64 size() const { return x.size(); }
    // The sum of masses.
    i64 check() const {
        require(y.size() == size() && mass.size() == size(), "columns of points differ in length");
        require(size() > 0, "no points to move mass from or to");
        i64 sum = 0;
        for (i64 one : mass) {
            require(one > 0 && one < MOST - sum, "masses must be positive, and less than 2^62 together");
            sum += one;
        }
        return sum;
    }
};

// Extent of two sets of numbers.
double reach(Span<const double> a, Span<const double> b) {
    auto [a0, a1] = std::minmax_element(a.begin(), a.end());
    auto [b0, b1] = std::minmax_element(b.begin(), b.end());
    return std::max(*a1, *b1) - std::min(*a0, *b0);
}

double length(double x, double y) { return std::sqrt(x * x + y * y); }

// Costs of the arcs to all sinks without the potential of their source, and the least of these costs.
NVSDATA_INLINE void find_offers(double x, double y, Span<const double> bx, Span<const double> by,
                                Span<const double> potential, Span<double> offers, double* least) {
    i64 sinks = bx.size(), whole = sinks - sinks % LANES;
    double lanes[LANES];
    for (double& lane : lanes) lane = std::numeric_limits<double>::infinity();
    for (i64 j = 0; j < whole; j += LANES)
        for (i64 lane = 0; lane < LANES; ++lane) {
            double dx = bx[j + lane] - x, dy = by[j + lane] - y;
            double offer = std::sqrt(dx * dx + dy * dy) - potential[j + lane];
            offers[j + lane] = offer;
            lanes[lane] = offer < lanes[lane] ? offer : lanes[lane];
        }
    for (i64 j = whole; j < sinks; ++j) {
        offers[j] = length(bx[j] - x, by[j] - y) - potential[j];
        lanes[0] = std::min(lanes[0], offers[j]);
    }
    *least = *std::min_element(lanes, lanes + LANES);
}

// A node, and the arc to its parent: its mass, its cost, and whether it points up.
struct Node {
    i64 mass;
    double cost;
    i32 parent, depth, child, following, previous;
    bool up;
};

class Tree {
public:
    Tree(const Points& from, const Points& to, i64 surplus)
        : from_(from), to_(to), surplus_(surplus), offers_(to.size()) {
        i64 sources = from.size(), sinks = to.size();
        // the last sink takes the surplus, from anywhere at no cost
        root_ = i32(sources + sinks + (surplus > 0));
        double far = length(reach(from.x, to.x), reach(from.y, to.y)) + 1;
        for (i32 node = 0; node <= root_; ++node) {
            bool source = node < sources;
            i64 mass = source ? from.mass[node] : node < sources + sinks ? to.mass[node - sources] : surplus;
            nodes_.push_back({mass, far, -1, 1, -1, -1, -1, source});
            potential_.push_back(source ? -far : far);
        }
        nodes_[root_].depth = 0;
        for (i32 node = 0; node < root_; ++node) attach(node, root_);
    }

    double solve() {
        Interrupt interrupt;
        i32 sources = i32(from_.size()), row = 0;
        i64 steps = 0;
        for (i32 without = 0; without < sources; row = row + 1 < sources ? row + 1 : 0) {
            if (++steps % PATIENCE == 0) interrupt.poll();
            Arc arc = best_arc(row);
            ++without;
            if (arc.reduced < -TOLERANCE) {
                pivot(arc);
                without = 0;
            }
        }
        double work = 0;
        for (i32 node = 0; node < root_; ++node)
            if (nodes_[node].parent != root_) work += double(nodes_[node].mass) * nodes_[node].cost;
        return work;
    }

private:
    struct Arc {
        i32 from, to;
        double cost, reduced;
    };
    const Points &from_, &to_;
    i64 surplus_;
    i32 root_;
    Vector<Node> nodes_;
    Vector<double> potential_, offers_;
    Vector<i32> stack_;

    // The arc from a source whose reduced cost is least.
    Arc best_arc(i32 source) {
        i32 sources = i32(from_.size()), sinks = i32(to_.size());
        double x = from_.x[source], y = from_.y[source], own = potential_[source], least;
        Span<const double> potential(potential_.data() + sources, i64(potential_.size()) - sources);
        best<find_offers>(x, y, to_.x, to_.y, potential, Span<double>(offers_), &least);
        if (surplus_ > 0 && -potential[sinks] < least) return {source, sources + sinks, 0, own - potential[sinks]};
        for (i32 j = 0; j < sinks; ++j)
            if (offers_[j] == least) return {source, sources + j, length(to_.x[j] - x, to_.y[j] - y), own + least};
        return {source, sources, 0, 0};
    }

    // Bring the arc into the tree, and push as much mass along its cycle as possible.
    void pivot(const Arc& arc) {
        i32 u = arc.from, v = arc.to, a = u, b = v;
        // the node where the two paths to the root meet, and the arc that blocks first; it exists, because arcs of
        // sources point up and those of sinks point down
        i64 least = MOST;
        i32 out = -1;
        bool below_u = true;
        while (a != b) {
            if (nodes_[a].depth >= nodes_[b].depth) {
                // ties: the arc nearest to u, and on the side of v the arc nearest to the meeting point
                if (nodes_[a].up && nodes_[a].mass < least) least = nodes_[a].mass, out = a;
                a = nodes_[a].parent;
            } else {
                b = nodes_[b].parent;
            }
        }
        i32 meeting = a;
        for (b = v; b != meeting; b = nodes_[b].parent)
            if (!nodes_[b].up && nodes_[b].mass <= least) least = nodes_[b].mass, out = b, below_u = false;
        for (a = u; a != meeting; a = nodes_[a].parent) nodes_[a].mass += nodes_[a].up ? -least : least;
        for (b = v; b != meeting; b = nodes_[b].parent) nodes_[b].mass += nodes_[b].up ? least : -least;
        // attach the subtree that is cut off to the other end of the arc
        i32 top = below_u ? u : v, node = top, above = below_u ? v : u;
        i64 mass = least;
        double cost = arc.cost;
        bool up = below_u;
        while (true) {
            Node old = nodes_[node];
            detach(node);
            attach(node, above);
            nodes_[node].mass = mass, nodes_[node].cost = cost, nodes_[node].up = up;
            if (node == out) break;
            mass = old.mass, cost = old.cost, up = !old.up;
            above = node;
            node = old.parent;
        }
        shift(top, below_u ? -arc.reduced : arc.reduced);
    }

    // Add to the potentials of a node and all below, and correct their depths.
    void shift(i32 top, double by) {
        stack_.assign(1, top);
        while (!stack_.empty()) {
            i32 node = stack_.back();
            stack_.pop_back();
            nodes_[node].depth = nodes_[nodes_[node].parent].depth + 1;
            potential_[node] += by;
            for (node = nodes_[node].child; node >= 0; node = nodes_[node].following) stack_.push_back(node);
        }
    }

    void attach(i32 node, i32 above) {
        i32 first = std::exchange(nodes_[above].child, node);
        nodes_[node].parent = above;
        nodes_[node].following = first;
        nodes_[node].previous = -1;
        if (first >= 0) nodes_[first].previous = node;
    }

    void detach(i32 node) {
        i32 before = nodes_[node].previous, after = nodes_[node].following;
        (before >= 0 ? nodes_[before].following : nodes_[nodes_[node].parent].child) = after;
        if (after >= 0) nodes_[after].previous = before;
    }
};

}  // namespace

double least_work(Span<const double> ax, Span<const double> ay, Span<const i64> am, Span<const double> bx,
                  Span<const double> by, Span<const i64> bm) {
    Points from{ax, ay, am}, to{bx, by, bm};
    i64 surplus = from.check() - to.check();
    if (surplus < 0) std::swap(from, to);
    require(ax.size() + bx.size() < std::numeric_limits<i32>::max(), "too many points");
    return Tree(from, to, std::abs(surplus)).solve();
}

void define_earth_mover(nb::module_& module) { define<least_work>(module, "least_work"); }

}  // namespace nvsdata
