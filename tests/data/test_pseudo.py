"""Pseudo-coordinates of every kind against a slow loop, by our kernel and by torch."""

import numpy as np
import pytest
import torch
from elsewhere import Elsewhere, Factories
from hypothesis import given
from hypothesis import strategies as st

from nvsdata import Events, GraphBatch
from nvsdata.data.pseudo import origin, pseudo
from nvsdata.transforms import KNNGraph, RadiusGraph

KINDS = ("abs", "signed", "signed-time")


def slow_pseudo(pos, t, edge_index, reach, kind):
    """Edge by edge, in float64; differences of times are exact."""
    rows = []
    for source, target in edge_index.T.tolist():
        offset = [*(pos[source].double() - pos[target].double()).tolist(), t[source].item() - t[target].item()]
        shares = [d / end for d, end in zip(offset[: len(reach)], reach, strict=True)]
        rows.append([min(abs(s), 1) if kind == "abs" else min(max(0.5 + s / 2, 0), 1) for s in shares])
    return torch.tensor(rows).reshape(len(rows), len(reach))


def by_torch(pos, t, edge_index, reach, kind):
    with Factories():
        return pseudo(Elsewhere(pos), Elsewhere(t), Elsewhere(edge_index), reach, kind).value


WAYS = {"kernel": pseudo, "torch": by_torch}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("way", WAYS)
@given(
    seed=st.integers(0, 2**32),
    nodes=st.integers(1, 12),
    edges=st.integers(0, 30),
    reach=st.tuples(*(st.sampled_from((1.0, 3.0, 8.0, 240.0)),) * 2, st.sampled_from((1.0, 33_333.0, 1e9))),
    late=st.sampled_from((0, -(2**61), 2**62 - 10**7)),
)
def test_pseudo_coordinates_are_those_of_a_slow_loop(way, kind, seed, nodes, edges, reach, late):
    generator = torch.Generator().manual_seed(seed)
    pos = torch.randint(0, 12, (nodes, 2), generator=generator) + torch.rand(nodes, 2, generator=generator).round() / 2
    t = torch.randint(0, 90_000, (nodes,), generator=generator) + late
    edge_index = torch.randint(nodes, (2, edges), generator=generator)
    reach = reach if kind == "signed-time" else reach[:2]
    found = WAYS[way](pos, t, edge_index, reach, kind)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, slow_pseudo(pos, t, edge_index, reach, kind).float(), rtol=0, atol=1e-6)


@pytest.mark.parametrize("way", WAYS)
def test_the_ends_and_the_middle(way):
    pos = torch.tensor([[10.0, 10.0], [13.0, 7.0], [50.0, 10.0]])
    t = torch.tensor([100, 300, -(10**12)])
    edges = torch.tensor([[0, 1, 2, 0], [0, 0, 0, 1]])
    made = [WAYS[way](pos, t, edges, reach, kind).tolist() for reach, kind in (((3.0, 3.0), "abs"), ((3, 3), "signed"))]
    assert made[0] == [[0, 0], [1, 1], [1, 0], [1, 1]]
    # from the target to the source
    assert made[1] == [[0.5, 0.5], [1, 0], [1, 0.5], [0, 1]]
    timed = WAYS[way](pos, t, edges, (3.0, 3.0, 400.0), "signed-time").tolist()
    assert timed == [[0.5, 0.5, 0.5], [1, 0, 0.75], [1, 0.5, 0], [0, 1, 0.25]]
    for kind, (first, *_) in zip(("abs", "signed", "signed-time"), (*made, timed), strict=True):
        assert set(first) == {origin(kind)}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("way", WAYS)
def test_what_is_nan_stays_nan(way, kind):
    pos = torch.tensor([[np.nan, 1.0], [2.0, 2.0]])
    reach = (3.0, 3.0, 9.0)[: 3 if kind == "signed-time" else 2]
    found = WAYS[way](pos, torch.tensor([0, 1]), torch.tensor([[0, 1], [1, 0]]), reach, kind)
    assert found[:, 0].isnan().all()
    assert found[:, 1:].isfinite().all()


def test_kinds_and_axes_that_do_not_fit():
    pos, t, edges = torch.zeros(2, 2), torch.zeros(2, dtype=torch.int64), torch.tensor([[0], [1]])
    with pytest.raises(ValueError, match=r"pseudo must be one of \('abs', 'signed', 'signed-time'\), not 'polar'"):
        pseudo(pos, t, edges, (3.0, 3.0), "polar")
    for kind, reach in (("signed-time", (3.0, 3.0)), ("signed", (3.0, 3.0, 9.0)), ("abs", (3.0,))):
        with pytest.raises(ValueError, match=f"reach has {len(reach)} numbers, which doesn't fit pseudo '{kind}'"):
            pseudo(pos, t, edges, reach, kind)
    for wrong in ([[0], [2]], [[-1], [0]]):
        with pytest.raises(IndexError, match="edge_index names a node that is not there"):
            pseudo(pos, t, torch.tensor(wrong), (3.0, 3.0))


EVENTS = Events([0, 500, 900], [5, 6, 6], [5, 5, 8], [0, 1, 0], (34, 34)).window(0, 1_000)


@pytest.mark.parametrize("kind", KINDS)
def test_graphs_have_what_they_say(kind):
    radius = RadiusGraph(3.5, alpha=4, pseudo=kind, reach_t=1_000)(EVENTS)
    nearest = KNNGraph(2, reach=5, pseudo=kind, reach_t=2_000)(EVENTS)
    assert radius.reach == ((1.75, 1.75, 1_000.0) if kind == "signed-time" else (1.75, 1.75))
    assert nearest.reach == ((5.0, 5.0, 2_000.0) if kind == "signed-time" else (5.0, 5.0))
    for graph in (radius, nearest):
        assert graph.pseudo == kind
        assert graph.num_edges
        expected = slow_pseudo(graph.pos, graph.t, graph.edge_index, graph.reach, kind)
        torch.testing.assert_close(graph.edge_attr, expected.float(), rtol=0, atol=1e-6)
        assert torch.equal(graph.moved(graph.pos).edge_attr, graph.edge_attr)


def test_graphs_of_different_kinds_do_not_mix():
    graphs = [RadiusGraph(pseudo=kind)(EVENTS) for kind in ("abs", "signed")]
    with pytest.raises(ValueError, match=r"graphs of different pseudo in one batch: \['abs', 'signed'\]"):
        GraphBatch.from_graphs(graphs)
    graphs[0] = RadiusGraph(pseudo="signed-time")(EVENTS)
    with pytest.raises(ValueError, match="graphs of different reach in one batch"):
        GraphBatch.from_graphs(graphs)
