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
from nvsdata.datasets import SeededDataset


def steady(n=1000, gap=1000, start=0):
    t = start + np.arange(n) * gap
    return Events(t, np.arange(n) % 40, np.arange(n) % 30, np.arange(n) % 2, (40, 30))


def test_random_windows_lie_in_the_parts_of_the_recording():
    ev = steady(start=1_600_000_000_000_000)
    starts = set()
    for _ in range(50):
        windows = T.RandomWindows(8, 33_333)(ev)
        assert len(windows) == 8
        for n, window in enumerate(windows):
            low = window.start - ev.start - 999_001 * n // 8
            assert 0 <= low <= 124_876 - 33_333
            assert window == ev.window(window.start, window.start + 33_333)
            starts.add(low)
    assert len(starts) > 300


@given(st.integers(1, 400), st.integers(1, 12), st.integers(1, 120), st.integers(0, 2**61))
def test_windows_overlap_only_where_they_do_not_fit(total, count, duration, first):
    """An event a µs: the windows show which of them were taken, and how often."""
    t = np.arange(total) + first
    ev = Events(t, np.zeros(total, int), np.zeros(total, int), np.zeros(total, int), (1, 1))
    windows = T.RandomWindows(count, duration)(ev)
    starts = [window.start - first for window in windows]
    assert len(windows) == count
    assert starts == sorted(starts)
    taken = np.zeros(total, int)
    for start, window in zip(starts, windows, strict=True):
        # whole windows, unless the recording is shorter than one
        assert len(window) == min(duration, total)
        taken[start : start + duration] += 1
        assert window.t.tolist() == t[start : start + duration].tolist()
    if count * duration <= total:
        assert taken.max() == 1
        for n, start in enumerate(starts):
            assert total * n / count - 1 < start
            assert start + duration <= total * (n + 1) / count
    else:
        # nothing is left out between the first and the last event, and all overlaps are equal
        assert taken.min() >= 1
        apart = np.diff(starts)
        assert count == 1 or np.ptp(apart) <= 1


@given(st.integers(0, 3), st.integers(0, 99))
def test_windows_in_the_parts_take_every_place(n, slack):
    """Any window within a part may be drawn, and none else."""
    count, duration = 4, 3
    total = 4 * (duration + slack % 4)
    ev = steady(total, 1)
    found = {T.RandomWindows(count, duration)(ev)[n].start for _ in range(120)}
    part = total // count
    assert found == set(range(n * part, (n + 1) * part - duration + 1))


def test_recordings_that_are_too_short():
    # the setting of Table 5.1: 8 windows of 1/30 s in 0.25 s
    windows = T.RandomWindows(8)(steady(251))
    assert [window.start for window in windows] == [(250_001 - 33_333) * n // 7 for n in range(8)]
    assert windows[-1].t[-1] == 250_000
    assert [window.start for window in T.RandomWindows(4, 33_333)(steady(10))] == [0, 0, 0, 0]
    assert [len(window) for window in T.RandomWindows(1, 33_333)(steady(10))] == [10]
    assert [len(window) for window in T.RandomWindows(3)(Events.empty((4, 4)))] == [0, 0, 0]


@pytest.mark.parametrize("total", [1000, 100, 10])
def test_windows_depend_on_seed_epoch_and_sample_alone(total, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        nvsdata.write(steady(total), tmp_path / name / "0.h5")
    transform = T.Compose([T.RandomWindows(8), T.Each(Starts())])
    dataset = SeededDataset(nvsdata.EventFolder(tmp_path, transform=transform), 7)
    drawn = {(epoch, n): dataset[epoch, n][0] for epoch in range(3) for n in range(2)}
    torch.manual_seed(5)
    for key in reversed(list(drawn)):
        assert dataset[key][0] == drawn[key]
    # a second draws otherwise only where there is a choice
    assert (drawn[0, 0] != drawn[1, 0]) == (total == 1000)


class Starts:
    """Where a window begins."""

    def __call__(self, window):
        return window.start


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
    windows = T.RandomWindows(8, 1_000)(recording)
    assert 0 < sum(len(window) for window in windows) == sum(read) <= 8 * 101


@given(events(max_size=60, width=20, height=20), st.sampled_from([1, 2, 5, 100]))
def test_each_event_hears_its_nearest(ev, k):
    graph = T.KNNGraph(k, reach=4)(ev)
    expected = []
    for i, (x, y, t) in enumerate(zip(ev.x.tolist(), ev.y.tolist(), ev.t.tolist(), strict=True)):
        others = [j for j in range(len(ev)) if j != i]
        # nearest in space; of equals in time, then the one of smaller index
        others.sort(key=lambda j: ((ev.x[j] - x) ** 2 + (ev.y[j] - y) ** 2, abs(ev.t[j] - t), j))
        expected += [(j, i) for j in sorted(others[:k])]
    assert list(zip(*graph.edge_index.tolist(), strict=True)) == expected
    offset = graph.pos[graph.edge_index[0]] - graph.pos[graph.edge_index[1]]
    assert torch.equal(graph.edge_attr, (offset / 8 + 0.5).clamp(0, 1))
    assert torch.equal(T.KNNGraph(k, reach=4, pseudo="abs")(ev).edge_attr, (offset / 4).abs().clamp(max=1))


def test_nearest_does_not_depend_on_an_offset_in_time():
    ev = steady(300, 37)
    late = Events(ev.t + 1_600_000_000_000_000, ev.x, ev.y, ev.p, ev.sensor_size)
    assert torch.equal(T.KNNGraph()(ev).edge_index, T.KNNGraph()(late).edge_index)


@given(events(max_size=50), st.integers(1, 5), st.integers(1, 7))
def test_a_grid_adds_up_the_nodes_of_a_cell(ev, wide, high):
    graph = T.KNNGraph()(ev)
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
        [T.RandomWindows(4), T.Each(T.Compose([T.NonUniformSample(4), T.KNNGraph()])), T.Graph2Grid((8, 6))]
    )
    dataset = nvsdata.EventFolder(tmp_path, transform=transform)
    loader = torch.utils.data.DataLoader(dataset, batch_size=2, collate_fn=nvsdata.collate)
    grids, targets = next(iter(loader))
    assert grids.shape == (2, 1, 4, 5, 5)
    assert targets.tolist() == [0, 1]


def test_what_has_no_grid():
    graph = T.KNNGraph()(steady(5))
    with pytest.raises(ValueError, match="at least one graph"):
        T.Graph2Grid()([])
    with pytest.raises(ValueError, match="without sensor_size"):
        T.Graph2Grid()(type(graph)(*(getattr(graph, k) for k in ("x", "pos", "t", "edge_index", "edge_attr"))))
    for build, says in (
        (lambda: T.Graph2Grid((0, 1)), "cluster must be"),
        (lambda: T.RandomWindows(0), "count must be a whole number of at least 1, not 0"),
        (lambda: T.RandomWindows(2.5), "count must be a whole number of at least 1, not 2.5"),
        (lambda: T.KNNGraph(k=0), "k must be a whole number of at least 1, not 0"),
        (lambda: T.KNNGraph(reach=0), "reach must be positive"),
    ):
        with pytest.raises(ValueError, match=says):
            build()
    with pytest.raises(TypeError, match="must be callable"):
        T.Each(3)


def test_windows_of_no_events_begin_at_0():
    none = Events.empty((4, 4))
    for window in (T.Window(0, 5)(none), T.RandomWindow(5)(none), *T.RandomWindows(2, 5)(none)):
        assert (len(window), window.start) == (0, 0)
