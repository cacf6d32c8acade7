import numpy as np
import pytest
import torch
from graphs import same
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from nvsdata import Events, GraphBatch
from nvsdata.kernels.graph import neighbors as cpu
from nvsdata.transforms import RadiusGraph
from nvsdata.transforms.events.sampling import BETA, LITERAL_BETA
from nvsdata.transforms.graphs import on_gpu

pytest.importorskip("triton.language")

from nvsdata.kernels.triton import neighbors as kernel

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")


def random_events(random, count, side, gap):
    x, y = random.integers(0, side, (2, count)).astype(np.int16)
    return np.cumsum(random.integers(0, gap + 1, count)), x, y


def assert_edges_of_the_cpu(graphs, radius, alpha, beta, k):
    """Compare the edges of all graphs, each (t, x, y), with those of our CPU kernel."""
    counts = [len(t) for t, _, _ in graphs]
    begins = np.cumsum([0, *counts[:-1]])
    expected = np.concatenate(
        [cpu.near_edges(*graph, radius, alpha, beta, k) + a for graph, a in zip(graphs, begins, strict=True)], 1
    )
    t, x, y = (
        torch.from_numpy(np.concatenate(column).astype(np.int64)).to(DEVICE) for column in zip(*graphs, strict=True)
    )
    graph = torch.repeat_interleave(torch.tensor(counts)).to(DEVICE)
    grid = len(graphs), int(y.max()) + 1, int(x.max()) + 1
    offsets = kernel.offsets_within(radius, alpha)
    found = kernel.near_edges(t, x, y, graph, grid, offsets, (radius, alpha, beta), min(k, max(max(counts) - 1, 1)))
    assert found.dtype == torch.int64
    assert found.tolist() == expected.tolist()


metrics = st.tuples(
    st.sampled_from((0.5, 1.0, 2.0, 2.9, 3.0)),
    st.sampled_from((1.0, 1.0, 0.7, 4.0)),
    st.sampled_from((0.0, BETA, LITERAL_BETA, 1e-3, 1.0, 1e12)),
    st.sampled_from((1, 2, 3, 8, 32, 1_000)),
)


# failures aren't made smaller, because the interpreter is slow
@settings(max_examples=20, phases=[Phase.generate])
@given(
    seed=st.integers(0, 2**32),
    counts=st.lists(st.integers(1, 20), min_size=1, max_size=2),
    side=st.sampled_from((1, 3, 12)),
    gap=st.sampled_from((0, 1, 20, 2_000, 10**6)),
    metric=metrics,
)
def test_edges_are_those_of_the_cpu(seed, counts, side, gap, metric):
    random = np.random.default_rng(seed)
    assert_edges_of_the_cpu([random_events(random, count, side, gap) for count in counts], *metric)


@pytest.mark.parametrize("k", [1, 2, 5])
def test_equals_are_told_apart_by_time_and_order(k):
    random = np.random.default_rng(k)
    # many events at few times and pixels: most distances are equal, many of them the radius
    graphs = [(np.sort(random.integers(0, 5, 60)), *random.integers(0, 3, (2, 60)).astype(np.int16)) for _ in range(2)]
    for radius, beta in ((1.0, 1.0), (2.0, 4.0), (1.0, 0.0)):
        assert_edges_of_the_cpu(graphs, radius, 1.0, beta, k)


def test_a_bit_decides_at_exactly_the_radius():
    # 4 (0.5e-5)² 200,000² is a bit more than 2², and 1.7 · 13 a bit more than the square of its root
    columns = np.array([0, 400_000]), *np.ones((2, 2), np.int16)
    assert_edges_of_the_cpu([columns], 2.0, 1.0, BETA, 3)
    place = np.array([0, 0]), np.array([0, 3], np.int16), np.array([0, 2], np.int16)
    assert_edges_of_the_cpu([place], 4.701063709417263, 1.7, 0.0, 1)


def test_wide_radii_are_left_to_the_cpu():
    assert len(kernel.offsets_within(3.0, 1.0)) == 29
    assert 2 * len(kernel.offsets_within(8.9, 1.0)) <= kernel.LANES
    for wide in (9.1, 1e9, np.inf):
        assert kernel.offsets_within(wide, 1.0) is None
    assert kernel.offsets_within(3.0, 1e-300) is None


def windows(seed=0):
    """Windows of different sizes, one without events, one late."""
    random = np.random.default_rng(seed)
    found = []
    for count, start in ((20, 0), (0, 5), (1, 7), (40, 2**61)):
        t, x, y = random_events(random, count, 8, 600)
        found.append(Events(t + start, x, y, random.integers(0, 2, count), (8, 8 if count else 20)))
    return found


@pytest.mark.parametrize("kind", ["abs", "signed", "signed-time"])
def test_batches_are_those_of_the_cpu(kind, monkeypatch):
    monkeypatch.setattr(on_gpu, "works", lambda device: True)
    graph, samples = RadiusGraph(2.5, max_degree=6, pseudo=kind), windows()
    limits = 2.5, 1.0, BETA, 6
    made = on_gpu.graphs_on_gpu(samples, DEVICE, limits, graph.reach((1, 1)), kind)
    assert made.num_edges > 50
    assert same(made.to("cpu"), GraphBatch.from_graphs([graph(events) for events in samples]))
    assert same(graph.batch(samples, DEVICE).to("cpu"), made.to("cpu"))
