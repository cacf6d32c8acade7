"""Moving mass between points at least cost: the transportation problem, by the network simplex method.

Sources and sinks are the nodes of a spanning tree that hangs from an artificial root. Each pivot
brings one arc into the tree and takes one out; the tree is kept strongly feasible (Cunningham 1976),
which rules out cycling, because integer masses are degenerate all the time.
"""

from __future__ import annotations

import math

import numpy as np

from nvsdata.kernels.compiling import njit

TOLERANCE = 1e-11  # of reduced costs: below it a pivot gains only rounding errors


@njit
def least_work(ax, ay, am, bx, by, bm):
    """Least sum of mass times Euclidean distance that moves min(sum am, sum bm) from a to b, (3.15).

    `ax`, `ay`, `bx`, `by` float64, `am`, `bm` int64 > 0, none of them empty. O(N + M) memory; costs
    are computed again at each use, which is no slower than reading a matrix.
    """
    if am.sum() < bm.sum():
        ax, ay, am, bx, by, bm = bx, by, bm, ax, ay, am
    sources, sinks = am.size, bm.size
    surplus = am.sum() - bm.sum()
    nodes = sources + sinks + (surplus > 0)  # the last sink takes the surplus, from anywhere at no cost
    root = nodes
    reach_x = max(ax.max(), bx.max()) - min(ax.min(), bx.min())
    reach_y = max(ay.max(), by.max()) - min(ay.min(), by.min())
    far = math.sqrt(reach_x * reach_x + reach_y * reach_y) + 1

    # the arc between a node and its parent: its mass, its cost, and whether it points up
    parent, depth = np.full(nodes + 1, root), np.ones(nodes + 1, np.int64)
    mass, cost = np.empty(nodes + 1, np.int64), np.full(nodes + 1, far)
    up, potential = np.ones(nodes + 1, np.bool_), np.full(nodes + 1, -far)
    child, following, previous = np.full((3, nodes + 1), -1)
    up[sources:], potential[sources:] = False, far
    for node in range(sources + sinks):
        mass[node] = am[node] if node < sources else bm[node - sources]
    if surplus:
        mass[nodes - 1] = surplus
    parent[root], depth[root], potential[root] = -1, 0, 0.0
    for node in range(nodes):
        _attach(node, root, parent, child, following, previous)
    stack, offers = np.empty(nodes + 1, np.int64), np.empty(sinks)

    row, without = 0, 0
    while without < sources:
        best, sink, price = _best_sink(
            ax[row], ay[row], bx, by, potential[row], potential[sources:], offers, surplus > 0
        )
        without += 1
        if best < -TOLERANCE:
            _pivot(
                row,
                sources + sink,
                price,
                best,
                parent,
                depth,
                mass,
                cost,
                up,
                potential,
                child,
                following,
                previous,
                stack,
            )
            without = 0
        row = row + 1 if row + 1 < sources else 0
    work = 0.0
    for node in range(nodes):
        if parent[node] != root:
            work += mass[node] * cost[node]
    return work


@njit(fastmath={"reassoc", "nnan", "nsz"})
def _best_sink(x, y, bx, by, own, potential, offers, dummy):
    """Least reduced cost of an arc from a source, the sink it leads to, and its cost."""
    least = np.inf
    for j in range(np.uint64(bx.size)):
        dx, dy = bx[j] - x, by[j] - y
        offer = math.sqrt(dx * dx + dy * dy) - potential[j]
        offers[j] = offer
        least = min(least, offer)
    if dummy and -potential[bx.size] < least:
        return own - potential[bx.size], bx.size, 0.0
    for j in range(bx.size):
        if offers[j] == least:
            dx, dy = bx[j] - x, by[j] - y
            return own + least, j, math.sqrt(dx * dx + dy * dy)
    return 0.0, 0, 0.0


@njit
def _pivot(u, v, price, reduced, parent, depth, mass, cost, up, potential, child, following, previous, stack):
    """Bring the arc from u to v into the tree, and push as much mass along its cycle as possible."""
    # where the two paths to the root meet, and the arc that blocks first
    least, out, below_u = np.int64(2**62), -1, True
    a, b = u, v
    while a != b:
        if depth[a] >= depth[b]:
            # of equals, the one nearest to u; on v's side, the one nearest to the meeting point
            if up[a] and mass[a] < least:
                least, out = mass[a], a
            a = parent[a]
        else:
            b = parent[b]
    meeting = a
    b = v
    while b != meeting:
        if not up[b] and mass[b] <= least:
            least, out, below_u = mass[b], b, False
        b = parent[b]
    a, b = u, v
    while a != meeting:
        mass[a] += -least if up[a] else least
        a = parent[a]
    while b != meeting:
        mass[b] += least if up[b] else -least
        b = parent[b]
    # hang the part that is cut off from the other end of the arc
    top, node, above = (u, u, v) if below_u else (v, v, u)
    new_mass, new_cost, new_up = least, price, below_u
    while True:
        old_parent, old_mass, old_cost, old_up = parent[node], mass[node], cost[node], up[node]
        _detach(node, parent, child, following, previous)
        _attach(node, above, parent, child, following, previous)
        mass[node], cost[node], up[node] = new_mass, new_cost, new_up
        if node == out:
            break
        above, node = node, old_parent
        new_mass, new_cost, new_up = old_mass, old_cost, not old_up
    shift = -reduced if below_u else reduced
    size, stack[0] = 1, top
    while size:
        size -= 1
        node = stack[size]
        depth[node] = depth[parent[node]] + 1
        potential[node] += shift
        node = child[node]
        while node >= 0:
            stack[size] = node
            size += 1
            node = following[node]


@njit
def _attach(node, above, parent, child, following, previous):
    parent[node] = above
    first = child[above]
    child[above], following[node], previous[node] = node, first, -1
    if first >= 0:
        previous[first] = node


@njit
def _detach(node, parent, child, following, previous):
    before, after = previous[node], following[node]
    if before >= 0:
        following[before] = after
    else:
        child[parent[node]] = after
    if after >= 0:
        previous[after] = before
