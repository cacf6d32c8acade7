"""Nodes of merged pixels, and features of nodes, against slow loops."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events
from nvsdata import transforms as T


def listed(ev):
    return list(zip(*(column.tolist() for column in ev.columns), strict=True))


def slow_merge(ev, times):
    """Nodes [(mean time, place of the first event, x, y, features)] in their order."""
    pixels = {}
    for number, (t, x, y, p) in enumerate(listed(ev)):
        pixels.setdefault((x, y), []).append((number, t, p))
    nodes = []
    for (x, y), members in pixels.items():
        found = {"first": members[0][1], "last": members[-1][1], "mean": sum(t for _, t, _ in members) // len(members)}
        on = sum(1 for *_, p in members if p)
        length = max(ev.end - ev.start, 1)
        shares = [(found[name] - ev.start) / length for name in times]
        nodes.append((found["mean"], members[0][0], x, y, [on, len(members) - on, *shares]))
    return sorted(nodes)


all_times = st.lists(st.sampled_from(("first", "last", "mean")), max_size=3, unique=True)


@given(events(max_size=80, width=9, height=7), all_times, st.sampled_from((0, 1_600_000_000_000_000, -(2**61))))
def test_the_events_of_a_pixel_become_a_node(ev, times, offset):
    ev = Events(ev.t + offset, ev.x, ev.y, ev.p, ev.sensor_size).window(offset - 5, offset + 200_000)
    graph = T.MergePixels(tuple(times))(ev)
    expected = slow_merge(ev, times)
    assert graph.t.tolist() == [mean - ev.start for mean, *_ in expected]
    assert graph.pos.tolist() == [[x, y] for _, _, x, y, _ in expected]
    features = torch.tensor([row for *_, row in expected]).reshape(len(expected), 2 + len(times))
    assert torch.equal(graph.x[:, :2], features[:, :2])
    torch.testing.assert_close(graph.x, features.float())
    assert (graph.x.dtype, graph.pos.dtype, graph.t.dtype) == (torch.float32, torch.float32, torch.int64)
    assert (graph.num_edges, graph.sensor_size, graph.y) == (0, ev.sensor_size, None)


@given(events(max_size=80, width=9, height=7))
def test_logarithms_of_numbers_leave_times_as_they_are(ev):
    plain, log = (T.MergePixels(("first", "last"), log)(ev).x for log in (False, True))
    torch.testing.assert_close(log[:, :2], plain[:, :2].log1p())
    assert torch.equal(log[:, 2:], plain[:, 2:])


@given(events(max_size=80, width=9, height=7))
def test_merged_pixels_hear_their_nearest(ev):
    graph = T.Compose([T.MergePixels(), T.KNNGraph()])(ev)
    nodes = graph.num_nodes
    assert nodes == len(set(zip(ev.x.tolist(), ev.y.tolist(), strict=True)))
    assert graph.x.sum() == len(ev)
    assert graph.edge_index[1].tolist() == (list(range(nodes)) if nodes > 1 else [])
    # no two nodes share a pixel
    offset = graph.pos[graph.edge_index[0]] - graph.pos[graph.edge_index[1]]
    assert (offset.abs().sum(1) >= 1).all()


def test_a_million_events_of_one_pixel_at_late_times():
    n = 1_000_000
    t = np.arange(n) + 2**62 - 10**7
    graph = T.MergePixels(("mean",))(Events(t, np.full(n, 3), np.full(n, 4), np.arange(n) % 4 == 0, (9, 9)))
    assert graph.t.tolist() == [(n - 1) // 2]
    assert graph.x[0, :2].tolist() == [n / 4, n * 3 / 4]
    assert graph.x[0, 2] == pytest.approx(0.5, abs=1e-5)


def slow_patch(ev, pos, size):
    """Counts by node, polarity (1, then 0), row and column, event by event."""
    half = size // 2
    counts = np.zeros((len(pos), 2, size, size))
    for node, (u, v) in enumerate(pos.tolist()):
        column, row = math.floor(u + 0.5), math.floor(v + 0.5)
        for _, x, y, p in listed(ev):
            if abs(x - column) <= half and abs(y - row) <= half:
                counts[node, 0 if p else 1, y - row + half, x - column + half] += 1
    return counts


@given(
    events(max_size=60, width=20, height=12),
    st.sampled_from((1, 3, 5, 7, 17)),
    st.sampled_from((0.0, 0.4, 0.6, -0.7, 1e4)),
)
def test_patches_count_the_events_around_a_node(ev, size, shift):
    nodes = T.RadiusGraph()(ev)
    # after an augmentation nodes lie between pixels, or beyond the sensor
    nodes = replace(nodes, pos=nodes.pos + torch.tensor([shift, -shift]))
    counts = torch.from_numpy(slow_patch(ev, nodes.pos, size))
    patch, mean = T.Patch(size)(ev, nodes), T.PatchMean(size)(ev, nodes)
    assert patch.dtype == mean.dtype == torch.float32
    assert patch.shape == (len(ev), 2 * size * size)
    torch.testing.assert_close(patch, counts.log1p().flatten(1).float())
    on, off = counts.sum((2, 3)).T
    both = on + off
    polarity = torch.where(both > 0, (on - off) / both.clamp(min=1), 0)
    torch.testing.assert_close(mean, torch.stack((both.log1p(), polarity), 1).float())


def test_a_patch_row_by_row():
    ev = Events([1, 2, 3, 4], [5, 6, 6, 5], [5, 5, 5, 4], [1, 1, 1, 0], (9, 9))
    patch = T.Patch(3)(ev, T.RadiusGraph()(ev))[0].expm1().round().tolist()
    assert patch == [0, 0, 0, 0, 1, 2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]


@given(events(max_size=60, width=20, height=12), st.integers(1, 5), st.sampled_from((0.0, 0.4, -0.7, 1e4)))
def test_bins_count_the_events_of_a_pixel_in_parts_of_the_window(ev, bins, shift):
    if len(ev):
        # a window that begins before its first event and ends after its last
        ev = Events(ev.t, ev.x, ev.y, ev.p, ev.sensor_size, start=int(ev.t[0]) - 700, end=int(ev.t[-1]) + 300)
    nodes = T.MergePixels()(ev)
    # after an augmentation nodes lie between pixels, or beyond the sensor
    nodes = replace(nodes, pos=nodes.pos + torch.tensor([shift, -shift]))
    expected = torch.zeros(nodes.num_nodes, 2, bins)
    for node, (u, v) in enumerate(nodes.pos.tolist()):
        for t, x, y, p in listed(ev):
            part = min(bins * (t - ev.start) // max(ev.end - ev.start, 1), bins - 1)
            expected[node, 0 if p else 1, part] += (x, y) == (math.floor(u + 0.5), math.floor(v + 0.5))
    found = T.TimeBins(bins)(ev, nodes)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, expected.log1p().flatten(1))


@given(events(max_size=60), st.integers(0, 5_000), st.integers(1, 90_000))
def test_age_is_a_share_of_the_window(ev, start, length):
    whole = Events(ev.t, ev.x, ev.y, ev.p, ev.sensor_size, start=0, end=10**6)
    window = whole.window(start, start + length + 1)
    age = T.Age()(window, T.RadiusGraph()(window))
    assert (age.dtype, age.shape) == (torch.float32, (len(window), 1))
    expected = [[(t - start) / length] for t in window.t.tolist()]
    torch.testing.assert_close(age, torch.tensor(expected).reshape(-1, 1))
    assert ((age >= 0) & (age <= 1)).all()
    # without an end that is known, up to the last event
    window = ev.window(start, start + length + 1)
    if len(window) and window.t[-1] > start:
        assert T.Age()(window, T.RadiusGraph()(window))[-1] == 1


@given(events(max_size=60, width=12, height=12))
def test_features_see_all_events_sampled_or_not(ev):
    sampled = T.Compose([T.NonUniformSample(4), T.RadiusGraph()])
    graph = T.NodeFeatures(sampled, [T.Age(), T.Patch(3), T.PatchMean(5), lambda _, nodes: nodes.pos])(ev)
    assert graph.x.shape == (graph.num_nodes, 1 + 1 + 18 + 2 + 2)
    assert (graph.x[:, :1].abs() == 1).all()
    torch.testing.assert_close(graph.x[:, 1], graph.t / max(ev.end - ev.start, 1))
    counts = torch.from_numpy(slow_patch(ev, graph.pos, 3))
    torch.testing.assert_close(graph.x[:, 2:20], counts.log1p().flatten(1).float())
    assert torch.equal(graph.x[:, 22:], graph.pos)


def test_features_of_merged_pixels():
    ev = Events([0, 10, 40, 100], [1, 1, 2, 1], [1, 1, 1, 1], [1, 0, 1, 1], (9, 9), start=0, end=200)
    features = T.NodeFeatures(T.Compose([T.MergePixels(("last",)), T.KNNGraph()]), [T.Age(), T.PatchMean(3)])
    graph = features(ev)
    assert graph.t.tolist() == [(0 + 10 + 100) // 3, 40]
    expected = [[2, 1, 0.5, 36 / 200, math.log(5), 0.5], [1, 0, 0.2, 40 / 200, math.log(5), 0.5]]
    torch.testing.assert_close(graph.x, torch.tensor(expected))


def test_features_of_other_types_become_the_graphs():
    ev = Events([1, 2], [1, 2], [1, 2], [0, 1], (9, 9))
    doubles = [lambda *_: np.full((2, 1), 0.5), lambda *_: torch.ones(2, 2, dtype=torch.int64)]
    graph = T.NodeFeatures(T.RadiusGraph(), doubles)(ev)
    assert graph.x.dtype == torch.float32
    assert graph.x.tolist() == [[-1, 0.5, 1, 1], [1, 0.5, 1, 1]]


def test_features_that_do_not_fit():
    ev = Events([1, 2], [1, 2], [1, 2], [0, 1], (9, 9))
    for values in (torch.zeros(3, 1), torch.zeros(2)):
        with pytest.raises(ValueError, match=r"returns \(.*\), not \[2, F\] for 2 nodes"):
            T.NodeFeatures(T.RadiusGraph(), [lambda *_, values=values: values])(ev)
    with pytest.raises(TypeError, match="a feature must be callable, not 'age'"):
        T.NodeFeatures(T.RadiusGraph(), ["age"])
    with pytest.raises(TypeError, match="returns Events, not a Graph"):
        T.NodeFeatures(T.NonUniformSample(), [T.Age()])(ev)
    with pytest.raises(TypeError, match="sample must be Events or a Recording, not Graph"):
        T.MergePixels()(T.RadiusGraph()(ev))
    with pytest.raises(ValueError, match=r"times must be of \('first', 'last', 'mean'\), not 'middle'"):
        T.MergePixels(("middle",))(ev)


def test_what_always_gives_the_same_says_so():
    fixed = T.NodeFeatures(T.Compose([T.MergePixels(), T.KNNGraph()]), [T.Age(), T.Patch()])
    assert fixed.deterministic
    assert not T.NodeFeatures(T.Compose([T.NonUniformSample(), T.KNNGraph()]), [T.Age()]).deterministic
    assert not T.NodeFeatures(T.KNNGraph(), [lambda *_: torch.rand(2, 1)]).deterministic
