import pytest
import torch

from nvsdata import Events, GraphBatch, collate, models
from nvsdata import transforms as T
from nvsdata.models.temporal import INCEPTION, temporal_network


def sequences(count=2, volumes=8, size=(240, 180), nodes=60, empty=()):
    samples = []
    for n in range(count):
        graphs = []
        for s in range(volumes):
            generator = torch.Generator().manual_seed(100 * n + s)
            here = 0 if (n, s) in empty else nodes
            x, y = (torch.randint(0, side, (here,), generator=generator).numpy() for side in size)
            graphs.append(T.KNNGraph()(Events(range(here), x, y, x % 2, size)))
        samples.append((graphs, n))
    return collate(samples)


def small(temporal="residual", **options):
    return models.RGCNN3D(3, temporal=temporal, channels=(4, 8), clusters=((8, 6), (16, 12)), **options)


@pytest.mark.parametrize("temporal", ["plain", "inception", "residual"])
@pytest.mark.parametrize(("name", "classes"), [("dvs128-gesture", 11), ("hmdb51-dvs", 51)])
def test_the_thesis_s_networks_run(name, classes, temporal):
    network = models.rgcnn3d(name, temporal).eval()
    batch = sequences(1, size=network.sensor_size).inputs
    with torch.no_grad():
        scores = network(batch)
    assert scores.shape == (1, classes)
    assert scores.isfinite().all()
    side = {"dvs128-gesture": 32, "hmdb51-dvs": 30}[name]
    assert network.grid.grid == (side, side)


@pytest.mark.parametrize("volumes", [8, 16])
def test_layers_are_those_of_section_5_3_1(volumes):
    x = torch.empty(1, 128, volumes, 30, 30, device="meta")
    # what is over at an edge is pooled, too: 30, 15, 8, 4, 2 pixels; 8, 7, 4, 2, 1 grids
    times = {8: (7, 4, 2, 1), 16: (15, 8, 4, 2)}[volumes]
    for kind, widths in (
        ("plain", (128, 256, 512, 512)),
        ("inception", (480, 512, 512, 512)),
        ("residual", (512, 1024)),
    ):
        with torch.device("meta"):
            layers, width = temporal_network(kind)
        assert width == widths[-1]
        shapes, maps = [], x
        for layer in layers.eval():
            maps = layer(maps)
            shapes.append(tuple(maps.shape[1:]))
        sides = (15, 8, 4, 2)
        assert shapes[1::2] == [(w, t, s, s) for w, t, s in zip(widths, times, sides, strict=False)]


def test_widths_of_inception_add_up():
    assert [a + b[1] + c[1] + d for a, b, c, d in INCEPTION] == [480, 512, 512, 512]


@pytest.mark.parametrize("temporal", ["plain", "inception", "residual"])
def test_gradients_are_finite_with_an_empty_window(temporal):
    network = small(temporal)
    batch, targets = sequences(empty={(0, 3), (1, 0), (1, 1)})
    torch.nn.functional.cross_entropy(network(batch), targets).backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.isfinite().all(), name


def test_batch_mates_and_order_of_nodes_change_nothing():
    network = small().eval()
    both = sequences(2).inputs
    alone = sequences(1).inputs
    with torch.no_grad():
        together = network(both)
        torch.testing.assert_close(network(alone), together[:1], atol=1e-5, rtol=0)
        # nodes of each graph the other way round
        order = torch.cat([torch.arange(a, b).flip(0) for a, b in zip(both.ptr[:-1], both.ptr[1:], strict=True)])
        where = torch.empty_like(order)
        where[order] = torch.arange(order.numel())
        edges = where[both.edge_index]
        by_target = edges[1].argsort(stable=True)
        turned = GraphBatch(
            **{
                **vars(both),
                "x": both.x[order],
                "pos": both.pos[order],
                "t": both.t[order],
                "edge_index": edges[:, by_target],
                "edge_attr": both.edge_attr[by_target],
            }
        )
        torch.testing.assert_close(network(turned), together, atol=1e-5, rtol=0)


def test_the_order_of_volumes_matters():
    network = small("plain").eval()
    batch = sequences(1).inputs
    with torch.no_grad():
        scores = network(batch)
    samples = [([*reversed(one_by_one(batch))], 0)]
    with torch.no_grad():
        assert not torch.allclose(network(collate(samples).inputs), scores)


def one_by_one(batch):
    return [
        T.KNNGraph()(Events(batch.t[a:b], *batch.pos[a:b].long().T.numpy(), batch.x[a:b, 0] > 0, (240, 180)))
        for a, b in zip(batch.ptr[:-1], batch.ptr[1:], strict=True)
    ]


def test_what_does_not_fit():
    with pytest.raises(ValueError, match="temporal must be one of"):
        models.rgcnn3d("hmdb51-dvs", "lstm")
    with pytest.raises(ValueError, match="no configuration 'n-mnist'"):
        models.rgcnn3d("n-mnist")
    with pytest.raises(ValueError, match="graphs of a sensor of 240x180, but the network is for 128x128"):
        models.rgcnn3d("dvs128-gesture")(sequences(1).inputs)
    with pytest.raises(ValueError, match="nodes have 1 features, but the network takes 2"):
        small(in_channels=2)(sequences(1).inputs)
    with pytest.raises(ValueError, match="equal lengths"):
        models.RGCNN3D(3, channels=(4,), clusters=())
