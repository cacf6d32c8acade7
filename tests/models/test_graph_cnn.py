from dataclasses import replace

import numpy as np
import pytest
import torch
from learning import learn, share_right
from lookalikes import saccade

import nvsdata
from nvsdata import Events, GraphBatch, models
from nvsdata import transforms as T
from nvsdata.training.objects import Objects


def recording(digit, seed=0, n=300):
    return Events(*saccade(np.random.default_rng(seed * 10 + digit), digit, n), (34, 34))


def graph(digit, seed=0):
    return T.RadiusGraph()(T.Window(0, 30_000)(recording(digit, seed)))


@pytest.mark.parametrize("build", [models.rgcnn, models.gcnn])
@pytest.mark.parametrize("name", sorted(models.CONFIGURATIONS))
def test_every_configuration_runs(build, name):
    model = build(name)
    scores = model(GraphBatch.from_graphs([graph(0), graph(1)]))
    assert scores.shape == (2, models.CONFIGURATIONS[name]["num_classes"])
    scores.sum().backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in model.parameters())


def test_the_thesis_layers_of_n_mnist():
    model = models.rgcnn("n-mnist")
    weights = [tuple(p.shape) for name, p in model.named_parameters() if name.endswith("conv.weight")]
    assert weights == [(25, 1, 32), (25, 32, 64), (25, 64, 128)]
    assert tuple(model.hidden.weight.shape) == (128, 5 * 5 * 128)


def test_unknown_names_are_refused():
    assert models.rgcnn("NMNIST").sensor_size == models.rgcnn("n_mnist").sensor_size == (34, 34)
    with pytest.raises(ValueError, match=r"no configuration 'imagenet'; .* build models.RGCNN\(num_classes, sensor"):
        models.rgcnn("imagenet")
    # such as the number of classes in place of the name
    with pytest.raises(ValueError, match="no configuration 10; "):
        models.rgcnn(10)


def test_a_sample_does_not_depend_on_its_batch():
    graphs = [graph(i % 10, i) for i in range(64)]
    model = models.rgcnn("n-mnist")
    model(GraphBatch.from_graphs(graphs))
    model.eval()
    together = model(GraphBatch.from_graphs(graphs))
    alone = torch.cat([model(g) for g in graphs])
    assert torch.allclose(together, alone, atol=1e-5)


def test_the_order_of_nodes_does_not_matter():
    g = graph(3)
    order = torch.randperm(g.num_nodes)
    place = torch.argsort(order)
    edges = place[g.edge_index]
    by_target = torch.argsort(edges[1], stable=True)
    shuffled = replace(
        g,
        x=g.x[order],
        pos=g.pos[order],
        t=g.t[order],
        edge_index=edges[:, by_target],
        edge_attr=g.edge_attr[by_target],
    )
    model = models.rgcnn("n-mnist").eval()
    assert torch.allclose(model(g), model(shuffled), atol=1e-5)


def test_plain_torch_gives_the_same_scores_and_gradients(monkeypatch):
    from nvsdata.models import clusters, spline, spline_sum

    batch = GraphBatch.from_graphs([graph(i) for i in range(8)])
    model = models.rgcnn("n-mnist").double()
    model.dropout.p = 0.0
    batch = replace(batch, x=batch.x.double())

    def scores_and_gradients():
        model.zero_grad()
        scores = model(batch)
        scores.square().sum().backward()
        return [scores.detach(), *(p.grad.clone() for p in model.parameters())]

    ours = scores_and_gradients()
    monkeypatch.setattr(spline, "spline_sum", spline_sum.spline_sum_torch)
    monkeypatch.setattr(clusters, "clusters_cpu", clusters.clusters_torch)
    monkeypatch.setattr(clusters._MaxRows, "apply", clusters.max_rows_torch)
    for a, b in zip(ours, scores_and_gradients(), strict=True):
        assert torch.allclose(a, b, rtol=1e-8, atol=1e-9)


def small(n):
    """Graphs that break careless code: no node, one node, nodes without edges."""
    return T.RadiusGraph()(
        Events(np.arange(n) * 10_000, np.arange(n) * 9, np.arange(n) * 9, np.zeros(n, int), (34, 34))
    )


@pytest.mark.parametrize("training", [True, False])
@pytest.mark.parametrize("sizes", [(0,), (1,), (3,), (0, 0), (0, 1, 3), (0, "normal"), ("normal", 0, 1)])
def test_degenerate_graphs_give_finite_numbers(sizes, training):
    graphs = [graph(1) if n == "normal" else small(n) for n in sizes]
    model = models.rgcnn("n-mnist").train(training)
    scores = model(GraphBatch.from_graphs(graphs))
    scores.sum().backward()
    assert scores.shape == (len(sizes), 10)
    assert scores.isfinite().all()
    assert all(p.grad.isfinite().all() for p in model.parameters() if p.grad is not None)
    assert all(b.isfinite().all() for b in model.buffers())


def test_an_empty_window_of_a_recording_makes_an_empty_graph():
    g = T.RadiusGraph()(recording(0).window(10**9, 10**9 + 5))
    assert (g.num_nodes, g.num_edges) == (0, 0)
    assert models.rgcnn("n-mnist").eval()(g).isfinite().all()


def test_sixteen_recordings_can_be_learnt_by_heart():
    samples = [(graph(i % 4, i), i % 4) for i in range(16)]
    batch, targets = nvsdata.collate(samples)
    model = models.RGCNN(4, dropout=0.0)
    assert learn(model, batch, targets, 60)[-1] < 0.05
    assert share_right(model, batch, targets) == 1


@pytest.mark.parametrize("pooling", ["max", "average"])
def test_nodes_are_activated_then_pooled(pooling):
    """Eqs. 4.6 and 4.9, node by node; an average of what is left of ReLU isn't ReLU of the average."""
    model = models.GCNN(3, channels=(4,), clusters=((7, 7),), hidden=6, dropout=0.0, pooling=pooling).double().eval()
    batch = GraphBatch.of(graph(3))
    batch = replace(batch, x=batch.x.double())
    with torch.no_grad():
        heard = torch.relu(model.features[0](batch).x)
        expected = torch.zeros(5 * 5, 4, dtype=torch.float64)
        cell = [int(y // 7) * 5 + int(x // 7) for x, y in batch.pos.tolist()]
        for place in set(cell):
            members = heard[[i for i, c in enumerate(cell) if c == place]]
            expected[place] = members.amax(0) if pooling == "max" else members.sum(0) / len(members)
        scores = model.classify(torch.relu(model.hidden(expected.view(1, -1))))
        assert torch.allclose(model(batch), scores, rtol=1e-9)


def test_pooling_is_a_setting_that_is_kept(tmp_path):
    batch = GraphBatch.of(graph(3))
    for build in (models.rgcnn, models.gcnn):
        model = build("n-mnist", pooling="average").eval()
        found = models.load(models.save(model, tmp_path / "a.safetensors")).model
        assert found.settings["pooling"] == "average"
        with torch.no_grad():
            assert torch.equal(found(batch), model(batch))
            # the weights are those of a network that takes the maximum, the scores aren't
            other = build("n-mnist")
            other.load_state_dict(model.state_dict())
            assert not torch.allclose(other.eval()(batch), model(batch))
    assert models.rgcnn3d("ucf101-dvs", "plain", pooling="average").settings["pooling"] == "average"
    with pytest.raises(ValueError, match="must be 'max' or 'average', not 'median'"):
        models.rgcnn("n-mnist", pooling="median")


def test_a_block_of_the_same_clusters_does_not_pool():
    """Pooling to the clusters that nodes are already changes nothing."""
    deep = models.RGCNN(3, channels=(4, 5, 5), clusters=((4, 4), (4, 4), (7, 7)), hidden=6, dropout=0.0).eval()
    assert [type(layer).__name__ for layer in deep.features[3:5]] == ["ResidualBlock", "Activation"]
    batch = GraphBatch.from_graphs([graph(seed) for seed in range(3)])
    with torch.no_grad():
        first = deep.features[:5](batch)
        again = deep.features[1](first)
        assert torch.equal(first.x, again.x)
        assert torch.equal(first.pos, again.pos)
        assert torch.equal(first.edge_index, again.edge_index)
        assert torch.allclose(first.edge_attr, again.edge_attr, atol=1e-6)
    with pytest.raises(ValueError, match=r"depth must be one of \(3, 4, 5\) for a sensor of 34 pixels, not 6"):
        Objects("n-mnist", depth=6).build((34, 34), 10)
    assert [Objects("n-mnist").build((34, 34), 10).dropout.p, Objects("n-cars").build((120, 100), 2).dropout.p] == [
        0.2,
        0.5,
    ]


def on(width, height, features=1, pseudo="signed"):
    """A graph of a sensor."""
    g = T.RadiusGraph(pseudo=pseudo)(Events([0, 10], [1, 2], [1, 2], [0, 1], (width, height)))
    return replace(g, x=torch.ones(2, features))


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (on(35, 34), "graphs of a sensor of 35x34, but the network is for 34x34$"),
        (on(34, 35), "graphs of a sensor of 34x35, but the network is for 34x34$"),
        (on(34, 34, 2), "nodes have 2 features, but the network takes 1$"),
        (
            on(34, 34, pseudo="signed-time"),
            r"edges have 3 pseudo-coordinates \('signed-time'\), but the network takes 2: build it with dim=3$",
        ),
    ],
)
def test_graphs_that_a_network_is_not_for(given, reason):
    for model in (
        models.GCNN(2),
        models.RGCNN3D(2, temporal="plain", sensor_size=(34, 34), channels=(4,), clusters=((4, 4),)),
    ):
        with pytest.raises(ValueError, match=reason):
            model(given)


def test_graphs_of_a_smaller_sensor_or_of_none_that_is_known():
    model = models.GCNN(2, channels=(4,), clusters=((7, 7),)).eval()
    expected = model(on(34, 34))
    for given in (on(33, 34), on(34, 3), replace(on(34, 34), sensor_size=None)):
        assert torch.equal(model(given), expected)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"channels": (4, 4)}, "channels and clusters must have equal lengths of at least 1, not 2 and 3"),
        ({"channels": (), "clusters": ()}, "channels and clusters must have equal lengths of at least 1, not 0 and 0"),
        (
            {"convolution": "sage"},
            r"convolution must be one of \('spline', 'gcn', .*, or a class of your own, not 'sage'",
        ),
        ({"convolution": 5}, "or a class of your own, not 5"),
        ({"convolution": lambda a, b: (a, b)}, r"convolution must return a torch.nn.Module, not \(1, 32\)"),
    ],
)
def test_settings_that_make_no_network(settings, reason):
    with pytest.raises(ValueError, match=reason):
        models.GCNN(2, **settings)


def test_weights_of_a_b_spline_begin_small_and_alike():
    torch.manual_seed(0)
    conv = models.SplineConv(7, 400, kernel_size=3, dim=2, root_weight=True)
    bound = 1 / (9 * 7) ** 0.5
    for weight in (conv.weight, conv.root):
        assert weight.abs().max() <= bound
        # uniform: none of a hundred parts is empty
        assert (torch.histc(weight, 100, -bound, bound) > 0).all()
    assert not conv.bias.any()
    assert models.SplineConv(1, 1).root is None
    assert models.SplineConv(1, 1, bias=False).bias is None
    assert repr(models.SplineConv(1, 2)) == "SplineConv(1, 2, kernel_size=5, dim=2)"
