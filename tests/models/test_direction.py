"""Networks on every kind of pseudo-coordinates: what they can tell apart, take, refuse and keep in a file."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from learning import learn, share_right

from nvsdata import Events, GraphBatch, models
from nvsdata import transforms as T

KINDS = ("abs", "signed", "signed-time")
SIZE = (32, 32)
END = 30_000
# cells of single pixels, then one for all: no place is known to the last layer, and no mean position is rounded
WIDE = {"sensor_size": SIZE, "clusters": ((1, 1), (1, 1), (32, 32)), "channels": (8, 8, 8), "hidden": 16}
NETWORKS = {
    "rgcnn": lambda dim: models.RGCNN(5, dim=dim, **WIDE),
    "gcnn": lambda dim: models.GCNN(5, dim=dim, **WIDE),
    "monet": lambda dim: models.GCNN(5, dim=dim, convolution="monet", **WIDE),
    "rgcnn3d": lambda dim: models.RGCNN3D(
        5, dim=dim, sensor_size=SIZE, clusters=((1, 1), (32, 32)), channels=(8, 8), temporal="plain"
    ),
}


def stream(seed=0, n=200):
    random = np.random.default_rng(seed)
    t = np.sort(random.choice(END, n, replace=False))
    # dense enough for neighbors
    x, y = random.integers(4, 20, (2, n))
    return Events(t, x, y, random.integers(0, 2, n), SIZE, start=0, end=END - 1)


def backwards(ev):
    return Events((END - 1 - ev.t)[::-1], ev.x[::-1], ev.y[::-1], ev.p[::-1], SIZE, start=0, end=END - 1)


def mirrored(ev):
    return Events(ev.t, SIZE[0] - 1 - ev.x, ev.y, ev.p, SIZE, start=0, end=END - 1)


def scores(name, kind, change=lambda ev: ev):
    """Scores of a random network for graphs whose neighbors no cap cuts off."""
    torch.manual_seed(1)
    model = NETWORKS[name](3 if kind == "signed-time" else 2).double().eval()
    for module in model.modules():
        # weights of a new network are small, and its shortcuts begin at 0
        if isinstance(module, models.SplineConv):
            torch.nn.init.normal_(module.weight)
        if isinstance(module, models.BatchNorm):
            torch.nn.init.ones_(module.weight)
    join = T.RadiusGraph(max_degree=500, pseudo=kind, reach_t=END)
    graphs = [join(change(stream(seed))) for seed in range(8)]
    batch = GraphBatch.from_graphs(graphs, volumes=8 if name == "rgcnn3d" else 1)
    with torch.no_grad():
        return model(replace(batch, x=batch.x.double(), edge_attr=batch.edge_attr.double()))


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("kind", KINDS)
def test_only_with_time_does_its_direction_count(name, kind):
    forth, back = scores(name, kind), scores(name, kind, backwards)
    assert forth.std() > 1e-4
    apart = ((forth - back).abs().max() / forth.std()).item()
    assert apart > 1e-3 if kind == "signed-time" else apart < 1e-9


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("kind", KINDS)
def test_only_with_a_sign_does_a_mirror_image_differ(name, kind):
    one, other = scores(name, kind), scores(name, kind, mirrored)
    apart = ((one - other).abs().max() / one.std()).item()
    assert apart < 1e-9 if kind == "abs" else apart > 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_offsets_alone_are_mirrored(kind):
    """The same nodes and edges, each edge seen from its other end."""
    torch.manual_seed(1)
    dim = 3 if kind == "signed-time" else 2
    conv = models.SplineConv(1, 4, dim=dim)
    graph = T.RadiusGraph(pseudo=kind, max_degree=500)(stream())
    turned = graph.edge_attr if kind == "abs" else 1 - graph.edge_attr
    one, other = (conv(graph.x, graph.edge_index, u) for u in (graph.edge_attr, turned))
    assert torch.allclose(one, other) == (kind == "abs")


def pooled_shares(kind, seed=0):
    pool = models.GraphPool((4, 4), SIZE)
    return pool(GraphBatch.of(T.RadiusGraph(pseudo=kind, reach_t=END)(stream(seed))))


@pytest.mark.parametrize("kind", KINDS)
def test_pooled_graphs_keep_their_kind(kind):
    out = pooled_shares(kind)
    assert out.pseudo == kind
    assert out.edge_attr.shape == (out.num_edges, 3 if kind == "signed-time" else 2)
    assert len(out.reach) == out.edge_attr.shape[1]
    for (source, target), share in zip(out.edge_index.T.tolist(), out.edge_attr.tolist(), strict=True):
        offset = [*(out.pos[source] - out.pos[target]).tolist(), (out.t[source] - out.t[target]).item()]
        parts = [d / end for d, end in zip(offset[: len(out.reach)], out.reach, strict=True)]
        expected = [min(abs(d), 1) if kind == "abs" else min(max(0.5 + d / 2, 0), 1) for d in parts]
        assert share == pytest.approx(expected, abs=1e-6)
    if kind == "signed-time":
        assert out.reach[2] == END
        assert out.edge_attr[:, 2].std() > 0.01


TRAINED = {"channels": (8, 12, 16), "clusters": ((2, 2), (4, 4), (8, 8)), "sensor_size": SIZE, "hidden": 16}


@pytest.mark.parametrize("build", [models.RGCNN, models.GCNN])
@pytest.mark.parametrize("convolution", ["spline", *models.CONVOLUTIONS])
def test_networks_with_time_can_be_trained(build, convolution):
    model = build(3, dim=3, kernel_size=3, convolution=convolution, dropout=0.0, **TRAINED)
    graphs = [T.RadiusGraph(pseudo="signed-time")(stream(seed)) for seed in range(3)]
    losses = learn(model, GraphBatch.from_graphs(graphs), torch.arange(3), 12, rate=1e-2)
    assert losses[-1] < losses[0] / 2


def test_a_gesture_is_told_from_its_reverse():
    """A network with time learns by heart what one without can't."""
    streams = [way(stream(seed)) for seed in range(4) for way in (lambda ev: ev, backwards)]
    targets = torch.tensor([0, 1] * 4)
    right = {}
    for kind in ("signed", "signed-time"):
        torch.manual_seed(0)
        model = models.RGCNN(2, dim=3 if kind == "signed-time" else 2, kernel_size=3, dropout=0.0, **TRAINED)
        join = T.RadiusGraph(max_degree=500, pseudo=kind)
        batch = GraphBatch.from_graphs([join(ev) for ev in streams])
        loss = learn(model, batch, targets, 40, rate=1e-2)[-1]
        right[kind] = loss, share_right(model, batch, targets)
    assert right["signed-time"][0] < 0.1
    assert right["signed-time"][1] == 1
    # a pair has the same scores
    assert right["signed"][0] > 0.6


def test_graphs_that_do_not_fit_the_network():
    plane, timed = (T.RadiusGraph(pseudo=kind)(stream()) for kind in ("signed", "signed-time"))
    wide = T.NodeFeatures(T.RadiusGraph(), [T.Age(), T.PatchMean()])(stream())
    sequence = {"sensor_size": SIZE, "channels": (4, 4), "clusters": ((2, 2), (4, 4))}
    for build in (lambda **o: models.RGCNN(3, **TRAINED, **o), lambda **o: models.RGCNN3D(3, **sequence, **o)):
        with pytest.raises(ValueError, match=r"3 pseudo-coordinates \('signed-time'\), but .* takes 2: build .* dim=3"):
            build()(timed)
        with pytest.raises(ValueError, match=r"2 pseudo-coordinates \('signed'\), but .* takes 3: build .* dim=2"):
            build(dim=3)(plane)
        with pytest.raises(ValueError, match="nodes have 4 features, but the network takes 1"):
            build()(wide)
        with pytest.raises(ValueError, match="nodes have 1 features, but the network takes 4"):
            build(in_channels=4)(plane)
    with pytest.raises(ValueError, match="dim must be at least 1, not 0"):
        models.RGCNN(3, dim=0)


SETTINGS = {
    "timed": (
        {"dim": 3, "kernel_size": 3},
        T.Compose([T.RandomWindow(20_000), T.NonUniformSample(2), T.RadiusGraph(pseudo="signed-time", reach_t=9_000)]),
    ),
    "text": ({}, T.Compose([T.RandomWindow(20_000), T.RadiusGraph(beta=0.5e-5, pseudo="abs", max_degree=8)])),
    "features": (
        {"in_channels": 1 + 1 + 18 + 2},
        T.Compose([T.RandomWindow(20_000), T.NodeFeatures(T.RadiusGraph(), [T.Age(), T.Patch(3), T.PatchMean(7)])]),
    ),
    "pixels": (
        {"in_channels": 4, "dim": 3, "kernel_size": 2},
        T.Compose([T.RandomWindow(20_000), T.MergePixels(("first", "last")), T.KNNGraph(2, pseudo="signed-time")]),
    ),
}


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("build", [models.RGCNN, models.GCNN])
def test_networks_and_pipelines_come_back_from_a_file(name, build, tmp_path):
    settings, pipeline = SETTINGS[name]
    model = build(3, **settings, **TRAINED).eval()
    assert T.from_repr(repr(pipeline)) == pipeline
    path = models.save(model, tmp_path / "m.safetensors", classes=("a", "b", "c"), transform=pipeline)
    loaded = models.load(path)
    assert loaded.transform == pipeline
    assert loaded.model.settings == model.settings
    graphs = []
    for transform in (pipeline, loaded.transform):
        torch.manual_seed(3)
        graphs.append(transform(stream()))
    assert torch.equal(loaded.model(graphs[1]), model(graphs[0]))
    assert loaded.predict(stream()) in loaded.classes


def test_a_sequence_network_with_time_comes_back(tmp_path):
    model = models.RGCNN3D(3, dim=3, in_channels=2, sensor_size=SIZE, channels=(4, 4), clusters=((2, 2), (4, 4))).eval()
    join = T.Compose([T.MergePixels(), T.KNNGraph(pseudo="signed-time", reach_t=4_000)])
    pipeline = T.Compose([T.RandomWindows(8, 3_000), T.Each(join)])
    loaded = models.load(models.save(model, tmp_path / "m.safetensors", transform=pipeline))
    assert loaded.transform == pipeline
    batch = GraphBatch.from_graphs(pipeline(stream()), volumes=8)
    assert torch.equal(loaded.model(batch), model(batch))
