import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events
from nvsdata.kernels import neighbors
from nvsdata.transforms import radius_graph


def slow_edges(ev, radius, alpha, beta, max_degree):
    """Edges by comparing everything with everything (eq. 4.2); nearest by distance, then index."""
    found = set()
    for i in range(len(ev)):
        near = []
        for j in range(len(ev)):
            dx, dy, dt = (float(int(c[i]) - int(c[j])) for c in (ev.x, ev.y, ev.t))
            d = alpha * (dx * dx + dy * dy) + beta * (dt * dt)
            if j != i and d <= radius * radius:
                near.append((d, j))
        found |= {(j, i) for _, j in sorted(near)[:max_degree]}
    return found


def edges(graph):
    return set(zip(*graph.edge_index.tolist(), strict=True))


settings = st.fixed_dictionaries(
    {
        "radius": st.sampled_from((0.5, 1.0, 2.9, 3.0, 7.5)),
        "alpha": st.sampled_from((0.0, 0.3, 1.0, 4.0)),
        "beta": st.sampled_from((0.0, 0.5e-5, 1.0)),
        "max_degree": st.sampled_from((1, 3, 32)),
    }
)


@pytest.mark.parametrize("sweep", [0, 10**9], ids=["cells", "sweep"])
@given(ev=events(max_size=60, gap=1_500), options=settings)
def test_edges_are_those_of_brute_force(sweep, ev, options):
    order = ("radius", "alpha", "beta", "max_degree")
    pairs = neighbors.radius_edges(ev.t, ev.x, ev.y, *(options[name] for name in order), sweep)
    assert set(zip(*pairs.tolist(), strict=True)) == slow_edges(ev, **options)


@given(events(max_size=60), st.sampled_from((0, -(10**15), 1_600_000_000_000_000, 2**62 - 200_000)))
def test_a_time_offset_changes_nothing(ev, offset):
    moved = Events(ev.t + offset, ev.x, ev.y, ev.p, ev.sensor_size)
    assert np.array_equal(radius_graph(ev).edge_index, radius_graph(moved).edge_index)
    assert np.array_equal(radius_graph(ev).edge_attr, radius_graph(moved).edge_attr)


@given(events(max_size=60, gap=400), st.randoms(use_true_random=False))
def test_the_order_of_events_changes_nothing(ev, random):
    # a cap that cuts between simultaneous sources at one distance goes by index, so none here
    order = list(range(len(ev)))
    random.shuffle(order)
    shuffled = Events(ev.t[order], ev.x[order], ev.y[order], ev.p[order], ev.sensor_size)

    def named(events):
        graph = radius_graph(events, max_degree=60)
        names = list(zip(*(c.tolist() for c in events.columns), strict=True))
        return sorted((names[a], names[b]) for a, b in edges(graph))

    assert named(shuffled) == named(ev)


@given(events(max_size=120, gap=200))
def test_edges_are_grouped_by_target_and_sorted(ev):
    source, target = radius_graph(ev, max_degree=4).edge_index.numpy()
    keys = target * (len(ev) + 1) + source
    assert (np.diff(keys) > 0).all()


def test_a_crowd_at_one_pixel_keeps_the_nearest():
    n = 2_000
    ev = Events(np.arange(n), np.full(n, 5), np.full(n, 5), np.zeros(n, int), (10, 10))
    graph = radius_graph(ev, max_degree=32)
    assert graph.num_edges == 32 * n
    assert (np.abs(np.diff(graph.edge_index.numpy(), axis=0)) <= 32).all()


def test_dense_scenes_agree_with_a_tree():
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(1)
    n = 20_000
    ev = Events(np.sort(rng.integers(0, 30_000, n)), rng.integers(0, 240, n), rng.integers(0, 180, n), np.zeros(n, int))
    points = np.stack([ev.x, ev.y, ev.t * np.sqrt(0.5e-5)], 1)
    pairs = cKDTree(points).query_pairs(3.0)
    both = {*pairs, *((b, a) for a, b in pairs)}
    assert edges(radius_graph(ev, max_degree=500)) == both
