import numpy as np
import pytest
import scipy.io
import torch
from learning import learn, share_right
from places import SHARED

from nvsdata import FormatError, GraphBatch, models
from nvsdata.data.author_graphs import read_author_graphs
from nvsdata.models.temporal import residual

FOLDER = SHARED / "author_graphs"


def released(path, **variables):
    scipy.io.savemat(path, variables)
    return path


def test_a_radius_graph(tmp_path):
    path = released(
        tmp_path / "a.mat",
        feature=np.array([[1], [-1], [1]], np.float32),
        pseudo=np.array([[0, 0], [2, 1], [127, 127]], np.float32),
        edge=np.array([[1, 0], [0, 1]], np.uint16),
        label=np.uint8([[7]]),
    )
    (graph,) = read_author_graphs(path)
    assert graph.x.flatten().tolist() == [1, -1, 1]
    assert graph.pos.tolist() == [[0, 0], [2, 1], [127, 127]]
    assert graph.edge_index.tolist() == [[1, 0], [0, 1]]
    assert torch.allclose(graph.edge_attr, torch.tensor([[5 / 6, 2 / 3], [1 / 6, 1 / 3]]))
    assert (graph.y, graph.sensor_size, graph.pseudo) == (7, (128, 128), "signed")
    (graph,) = read_author_graphs(path, pseudo="abs")
    assert torch.allclose(graph.edge_attr, torch.tensor([[2 / 3, 1 / 3]] * 2))
    with pytest.raises(ValueError, match="reach has 2 numbers, which doesn't fit pseudo 'signed-time'"):
        read_author_graphs(path, pseudo="signed-time")


def test_a_sequence_of_nearest_neighbors(tmp_path):
    graphs = np.empty((1, 2), [("feature", "O"), ("pos", "O"), ("edge", "O")])
    for n in range(2):
        # the third node hears the first
        graphs[0, n] = (
            np.ones((3, 2)),
            np.array([[1, 1], [3, 2], [240, 180]]),
            np.array([[2, 0, 1], [0, 1, 0]], np.uint8),
        )
    first, second = read_author_graphs(released(tmp_path / "a.mat", graph=graphs, No=2))
    assert first.pos.tolist() == [[0, 0], [2, 1], [239, 179]]
    assert first.edge_index.tolist() == [[1, 0, 0], [0, 1, 2]]
    assert torch.allclose(first.edge_attr, torch.tensor([[5 / 8, 9 / 16], [3 / 8, 7 / 16], [0, 0]]))
    assert first.sensor_size == second.sensor_size == (240, 180)


def test_what_is_no_such_file_is_refused(tmp_path):
    with pytest.raises(FormatError, match="but \\['events'\\]"):
        read_author_graphs(released(tmp_path / "a.mat", events=np.zeros(3)))
    good = {"feature": np.ones((2, 1)), "pseudo": np.ones((2, 2)), "edge": np.array([[0, 1], [1, 0]])}
    with pytest.raises(FormatError, match="names nodes from 0 to 5; there are 2"):
        read_author_graphs(released(tmp_path / "b.mat", **good | {"edge": np.array([[0, 5], [1, 0]])}))
    with pytest.raises(FormatError, match=r"not \[N, F\]"):
        read_author_graphs(released(tmp_path / "c.mat", **good | {"pseudo": np.ones((3, 2))}))
    whole = released(tmp_path / "d.mat", **good).read_bytes()
    (tmp_path / "e.mat").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError, match=r"e\.mat"):
        read_author_graphs(tmp_path / "e.mat")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        # MATLAB knows no arrays of one dimension: this one is a row
        ({"feature": np.ones(2)}, r"feature \(1, 2\), positions \(2, 2\)"),
        ({"feature": np.ones((2, 1, 1))}, r"feature \(2, 1, 1\), positions \(2, 2\) and edges \(2, 2\), not \[N, F\]"),
        ({"pseudo": np.ones((2, 3))}, r"positions \(2, 3\)"),
        ({"edge": np.zeros((3, 2))}, r"edges \(3, 2\), not \[N, F\], \[N, 2\] and \[2, E\]$"),
        ({"edge": np.zeros((2, 2, 2))}, r"edges \(2, 2, 2\)"),
    ],
)
def test_arrays_of_other_shapes_are_told(tmp_path, change, message):
    good = {"feature": np.ones((2, 1)), "pseudo": np.ones((2, 2)), "edge": np.array([[0, 1], [1, 0]])}
    with pytest.raises(FormatError, match=message):
        read_author_graphs(released(tmp_path / "a.mat", **good | change))
    (graph,) = read_author_graphs(released(tmp_path / "a.mat", **good))
    assert (graph.y, graph.t.tolist(), graph.t.dtype, graph.reach) == (None, [0, 0], torch.int64, (3.0, 3.0))
    with pytest.raises(FormatError, match=r"feature, pseudo and edge nor a struct `graph` with them, but \['graph'\]$"):
        read_author_graphs(released(tmp_path / "b.mat", graph=np.ones(3)))


@pytest.mark.parametrize("form", [str, lambda path: path])
def test_a_file_that_is_not_there_is_told_as_such(tmp_path, form):
    with pytest.raises(FileNotFoundError, match=r"a\.mat"):
        read_author_graphs(form(tmp_path / "a.mat"))
    (tmp_path / "b.mat").write_bytes(b"MATLAB 5.0")
    with pytest.raises(FormatError, match=r"b\.mat: can't be read as MATLAB v5: "):
        read_author_graphs(form(tmp_path / "b.mat"))


@pytest.mark.skipif(not FOLDER.is_dir(), reason="no released graphs here")
def test_released_graphs_of_objects_can_be_learnt():
    graphs = [read_author_graphs(path)[0] for path in sorted((FOLDER / "cifar10-dvs").glob("*.mat"))]
    assert all(g.num_nodes > 100 and g.pos.max() < 128 and g.edge_attr.max() <= 1 for g in graphs)
    model = models.rgcnn("cifar10-dvs")
    model.dropout.p = 0.0
    targets = torch.tensor([g.y for g in graphs])
    batch = GraphBatch.from_graphs(graphs)
    assert learn(model, batch, targets, 12)[-1] < 0.1
    assert share_right(model, batch, targets) == 1


@pytest.mark.skipif(not FOLDER.is_dir(), reason="no released graphs here")
def test_released_graphs_of_actions_can_be_learnt():
    recordings = [read_author_graphs(path) for path in sorted((FOLDER / "ucf101-dvs").glob("*.mat"))]
    assert all(g.x.shape[1] == 2 and g.pos.min() >= 0 for graphs in recordings for g in graphs)
    sequences = [[graphs[n * len(graphs) // 8] for n in range(8)] for graphs in recordings]
    batch = GraphBatch.from_graphs([graph for sequence in sequences for graph in sequence], volumes=8)
    # all are of one class: the network is to tell the recordings apart
    model = models.RGCNN3D(3, in_channels=2, channels=(8, 16, 32), clusters=((4, 3), (12, 9), (48, 36)))
    # the thesis's 3D CNN learns them too, in minutes
    model.temporal, model.classify = residual(32, 32, 32), torch.nn.Linear(32, 3)
    assert learn(model, batch, torch.arange(3), 40)[-1] < 0.1
    assert share_right(model, batch, torch.arange(3)) == 1
