"""torch's own tools see the tensors of graphs."""

import io
from dataclasses import replace

import pytest
import torch
from graphs import scattered as graph
from torch.utils import _pytree as pytree

from nvsdata import GraphBatch


class Mean(torch.nn.Module):
    """The mean over all nodes of a linear layer."""

    def __init__(self):
        super().__init__()
        self.linear = torch.nn.Linear(1, 3)

    def forward(self, graph):
        return self.linear(graph.x).mean(0)


@pytest.mark.parametrize("made", [graph(), replace(graph(), y=2), GraphBatch.of(replace(graph(), y=2))])
def test_tensors_are_leaves_and_the_rest_is_context(made):
    leaves, spec = pytree.tree_flatten(made)
    assert len(leaves) == sum(isinstance(value, torch.Tensor) for value in vars(made).values())
    stored = pytree.treespec_loads(pytree.treespec_dumps(spec))
    assert stored == spec
    back = pytree.tree_unflatten(leaves, stored)
    assert type(back) is type(made)
    assert all(getattr(back, name) is value for name, value in vars(made).items() if isinstance(value, torch.Tensor))
    assert (back.reach, back.sensor_size) == (made.reach, made.sensor_size)
    paths = [path[0].name for path, _ in pytree.tree_flatten_with_path(made)[0]]
    assert paths[:3] == ["x", "pos", "t"]
    assert torch.equal(pytree.tree_map(lambda tensor: tensor * 2, made).t, made.t * 2)


@pytest.mark.parametrize("form", [lambda g: g, GraphBatch.of])
def test_a_network_that_takes_graphs_is_exported_and_stored(form):
    network, given, other = Mean(), form(graph(90, 1)), form(graph(70, 2))
    sizes = torch.export.ShapesCollection()
    sizes[given.x] = sizes[given.pos] = sizes[given.t] = sizes[given.edge_attr] = {0: torch.export.Dim.DYNAMIC}
    sizes[given.edge_index] = {1: torch.export.Dim.DYNAMIC}
    if isinstance(given, GraphBatch):
        sizes[given.batch] = {0: torch.export.Dim.DYNAMIC}
    exported = torch.export.export(network, (given,), dynamic_shapes=sizes)
    file = io.BytesIO()
    torch.export.save(exported, file)
    file.seek(0)
    for program in (exported, torch.export.load(file)):
        torch.testing.assert_close(program.module()(other), network(other))


def test_graphs_are_loaded_as_data():
    file = io.BytesIO()
    torch.save(GraphBatch.of(graph()), file)
    file.seek(0)
    assert torch.equal(torch.load(file, weights_only=True).edge_index, graph().edge_index)
