"""Sequences of graphs: windows, nearest neighbors, grids."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import Events
from nvsdata import transforms as T


def steady(n=1000, gap=1000, start=0):
    t = start + np.arange(n) * gap
    return Events(t, np.arange(n) % 40, np.arange(n) % 30, np.arange(n) % 2, (40, 30))


def test_volumes_lie_in_the_parts_of_the_recording():
    ev = steady(start=1_600_000_000_000_000)
    starts = set()
    for _ in range(50):
        windows = T.Volumes(8, 33_333)(ev)
        assert len(windows) == 8
        for n, window in enumerate(windows):
            low = window.start - ev.start - 999_001 * n // 8
            assert 0 <= low <= 124_876 - 33_333
            assert window == ev.window(window.start, window.start + 33_333)
            starts.add(low)
    assert len(starts) > 300


def test_short_recordings_give_windows_at_the_beginning_of_each_part():
    ev = steady(10)
    windows = T.volumes(ev, 4, 33_333)
    assert [window.start for window in windows] == [0, 2250, 4500, 6750]
    assert [len(window) for window in T.volumes(Events.empty((4, 4)), 3)] == [0, 0, 0]


def test_only_the_windows_are_decoded(tmp_path, monkeypatch):
    nvsdata.write(steady(100_000, 10), tmp_path / "a.h5")
    recording = nvsdata.open(tmp_path / "a.h5")
    monkeypatch.setattr(type(recording), "decode", lambda self: pytest.fail("decoded as a whole"))
    read = []
    original = type(recording)._events

    def counted(self, sources, first, t):
        read.append(t.size)
        return original(self, sources, first, t)

    monkeypatch.setattr(type(recording), "_events", counted)
    windows = T.Volumes(8, 1_000)(recording)
    assert 0 < sum(len(window) for window in windows) == sum(read) <= 8 * 101


@given(events(max_size=60, width=20, height=20), st.sampled_from([0.0, 0.5e-5, 1e-3]))
def test_each_event_hears_its_nearest(ev, beta):
    graph = T.knn_graph(ev, beta=beta, reach=4)
    n = len(ev)
    assert graph.num_edges == (n if n > 1 else 0)
    if n < 2:
        return
    x, y, t = (column.astype(float) for column in (ev.x, ev.y, ev.t - ev.start))
    far = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2 + beta * (t[:, None] - t) ** 2
    np.fill_diagonal(far, np.inf)
    assert graph.edge_index[1].tolist() == list(range(n))
    assert graph.edge_index[0].tolist() == far.argmin(1).tolist()
    offset = (graph.pos[graph.edge_index[0]] - graph.pos[graph.edge_index[1]]).abs()
    assert torch.equal(graph.edge_attr, (offset / 4).clamp(max=1))


def test_nearest_does_not_depend_on_an_offset_in_time():
    ev = steady(300, 37)
    late = Events(ev.t + 1_600_000_000_000_000, ev.x, ev.y, ev.p, ev.sensor_size)
    assert torch.equal(T.knn_graph(ev).edge_index, T.knn_graph(late).edge_index)


@given(events(max_size=50), st.integers(1, 5), st.integers(1, 7))
def test_a_grid_adds_up_the_nodes_of_a_cell(ev, wide, high):
    graph = T.knn_graph(ev)
    grid = T.Graph2Grid((wide, high))([graph, graph])
    width, height = ev.sensor_size
    expected = np.zeros((-(-height // high), -(-width // wide)))
    for x, y, p in zip(ev.x.tolist(), ev.y.tolist(), ev.p.tolist(), strict=True):
        expected[y // high, x // wide] += 2 * p - 1
    assert grid.shape == (1, 2, *expected.shape)
    for volume in grid[0]:
        np.testing.assert_array_equal(volume, expected)


def test_a_dataset_can_hand_back_grids(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        nvsdata.write(steady(), tmp_path / name / "0.h5")
    transform = T.Compose(
        [T.Volumes(4), T.Each(T.Compose([T.NonUniformSample(4), T.KNNGraph()])), T.Graph2Grid((8, 6))]
    )
    dataset = nvsdata.EventFolder(tmp_path, transform=transform)
    loader = torch.utils.data.DataLoader(dataset, batch_size=2, collate_fn=nvsdata.collate)
    grids, targets = next(iter(loader))
    assert grids.shape == (2, 1, 4, 5, 5)
    assert targets.tolist() == [0, 1]


def test_what_has_no_grid():
    graph = T.knn_graph(steady(5))
    with pytest.raises(ValueError, match="at least one graph"):
        T.graph2grid([])
    with pytest.raises(ValueError, match="without sensor_size"):
        T.graph2grid(type(graph)(*(getattr(graph, k) for k in ("x", "pos", "t", "edge_index", "edge_attr"))))
    for build, says in (
        (lambda: T.Graph2Grid((0, 1)), "cluster must be"),
        (lambda: T.Volumes(0), "count must be positive"),
        (lambda: T.KNNGraph(alpha=0), "alpha must be positive"),
    ):
        with pytest.raises(ValueError, match=says):
            build()
    with pytest.raises(TypeError, match="must be callable"):
        T.Each(3)
