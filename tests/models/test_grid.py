import pytest
import torch

from nvsdata import Events, GraphBatch, models
from nvsdata import transforms as T


def graphs(count=6, size=(240, 180)):
    made = []
    for n in range(count):
        generator = torch.Generator().manual_seed(n)
        x, y = (torch.randint(0, side, (40 * (n != 1),), generator=generator).numpy() for side in size)
        made.append(T.KNNGraph()(Events(range(len(x)), x, y, x % 2, size)))
    return made


def test_pooled_nodes_go_to_the_cells_of_their_clusters():
    batch = GraphBatch.from_graphs(graphs(), volumes=3)
    pooled = models.GraphPool((8, 6), (240, 180))(batch)
    grid = models.Graph2GridLayer((8, 6), (240, 180))(pooled)
    assert grid.shape == (2, 1, 3, 30, 30)
    expected = torch.zeros_like(grid)
    for node in range(pooled.num_nodes):
        graph, (x, y) = int(pooled.batch[node]), pooled.pos[node].tolist()
        expected[graph // 3, :, graph % 3, int(y) // 6, int(x) // 8] = pooled.x[node]
    assert torch.equal(grid, expected)
    assert (grid[0, :, 1] == 0).all()  # the graph without nodes


def test_gradients_reach_every_node():
    batch = GraphBatch.from_graphs(graphs(2), volumes=1)
    x = torch.randn(batch.num_nodes, 3, dtype=torch.float64, requires_grad=True)
    module = models.Graph2GridLayer((60, 45), (240, 180))

    def run(values):
        return module(GraphBatch(**{**vars(batch), "x": values}))

    assert torch.autograd.gradcheck(run, x)


def test_one_graph_is_a_batch_of_one():
    assert models.Graph2GridLayer((8, 6), (240, 180))(graphs(1)[0]).shape == (1, 1, 1, 30, 30)
    with pytest.raises(ValueError, match="cluster must be"):
        models.Graph2GridLayer((0, 6), (240, 180))
