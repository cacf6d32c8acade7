import pytest
import torch

from nvsdata import Events, GraphBatch, models
from nvsdata import transforms as T


def learnt(model):
    """A network whose statistics and normalization are no longer those of the start."""
    generator = torch.Generator().manual_seed(0)
    for module in model.modules():
        if isinstance(module, models.BatchNorm):
            for tensor in (module.weight, module.bias, module.running_mean):
                tensor.data.normal_(generator=generator)
            module.running_var.uniform_(0.2, 3, generator=generator)
        if isinstance(module, models.SplineConv):
            module.bias.data.normal_(generator=generator)
    return model.double().eval()


def batch(sensor_size=(34, 34), graphs=4, volumes=1, **options):
    def one(seed):
        generator = torch.Generator().manual_seed(seed)
        x, y = (torch.randint(0, side, (150,), generator=generator).numpy() for side in sensor_size)
        return T.RadiusGraph(**options)(Events(torch.arange(150).numpy() * 50, x, y, (x + y) % 2, sensor_size))

    made = GraphBatch.from_graphs([one(seed) for seed in range(graphs)], volumes=volumes)
    return made.__class__(**{**vars(made), "x": made.x.double()})


NETWORKS = {
    "rgcnn": lambda: models.RGCNN(5),
    "gcnn": lambda: models.GCNN(5),
    "average": lambda: models.RGCNN(5, pooling="average"),
    "kernel of one cell": lambda: models.RGCNN(5, kernel_size=1),
    "other convolution": lambda: models.GCNN(5, convolution="cheb"),
    "residual of another": lambda: models.RGCNN(5, convolution="gin"),
    "rgcnn3d": lambda: models.RGCNN3D(5, sensor_size=(34, 34), channels=(8, 16), clusters=((2, 2), (4, 4))),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_a_fused_network_gives_the_same_scores(name):
    model = learnt(NETWORKS[name]())
    graphs = batch(graphs=8, volumes=8) if name == "rgcnn3d" else batch()
    before = {key: value.clone() for key, value in model.state_dict().items()}
    with torch.no_grad():
        expected, scores = model(graphs), models.fused(model)(graphs)
    assert expected.std() > 1e-3
    assert torch.allclose(scores, expected, rtol=1e-9, atol=1e-9)
    assert all(torch.equal(value, before[key]) for key, value in model.state_dict().items())


def normalized_convolution(x, edges, u, conv, norm):
    """(4.6) without activation, and (4.7) with running statistics, edge by edge; a node is its own neighbor, too."""
    heard = [[] for _ in x]
    for (source, target), offset in zip(edges.T.tolist(), u.tolist(), strict=True):
        heard[target].append((x[source], offset))
    size = round(len(conv.weight) ** 0.5)
    knots = [(column, row) for row in range(size) for column in range(size)]
    rows = []
    for node, features in enumerate(x):
        total = torch.zeros(conv.weight.shape[2], dtype=torch.float64)
        for other, (a, b) in (*heard[node], (features, (0.5, 0.5))):
            for cell, (column, row) in enumerate(knots):
                hats = [max(0.0, 1 - abs(v * (size - 1) - k)) if size > 1 else 1.0 for v, k in ((a, column), (b, row))]
                total += hats[0] * hats[1] * (other @ conv.weight[cell]) / (len(heard[node]) + 1)
        rows.append(total + features @ conv.root + conv.bias)
    deviation = (norm.running_var + norm.eps).sqrt()
    return (torch.stack(rows) - norm.running_mean) / deviation * norm.weight + norm.bias


@pytest.mark.parametrize("fuse", [False, True])
def test_a_block_is_that_of_the_text_fused_or_not(fuse):
    """4.2.5: a convolution and a shortcut of kernel size 1, each normalized, added up."""
    graphs = batch(graphs=1, pseudo="signed")
    whole = learnt(models.RGCNN(5, channels=(3, 4), clusters=((2, 2), (4, 4))))
    inputs = graphs.__class__(**{**vars(graphs), "x": torch.randn(150, 3, dtype=torch.float64)})
    block, first = whole.features[3], whole.features[0]
    edges, u = graphs.edge_index, graphs.edge_attr.double()
    with torch.no_grad():
        plain = normalized_convolution(inputs.x, edges, u, block.conv, block.norm)
        shortcut = normalized_convolution(inputs.x, edges, u, block.shortcut, block.shortcut_norm)
        begin = normalized_convolution(graphs.x, edges, u, first.conv, first.norm)
        layers = models.fused(whole).features if fuse else whole.features
        torch.testing.assert_close(layers[3](inputs).x, plain + shortcut, rtol=1e-6, atol=1e-6)
        torch.testing.assert_close(layers[0](graphs).x, begin, rtol=1e-6, atol=1e-6)
    assert shortcut.std() > 0.1


@pytest.mark.parametrize("kind", ["abs", "signed", "signed-time"])
def test_a_fused_network_takes_every_kind_of_pseudo_coordinates(kind):
    model = learnt(models.RGCNN(5, dim=3 if kind == "signed-time" else 2))
    graphs = batch(pseudo=kind, reach_t=5_000)
    with torch.no_grad():
        expected, scores = model(graphs), models.fused(model)(graphs)
    assert torch.allclose(scores, expected, rtol=1e-9, atol=1e-9)


def test_it_computes_less():
    model = models.rgcnn("n-mnist").eval()
    fused = models.fused(model)
    sample = batch(graphs=1)
    sample = sample.__class__(**{**vars(sample), "x": sample.x.float()})
    assert models.complexity(fused, sample).executed < models.complexity(model, sample).executed
    assert not any(isinstance(module, models.BatchNorm) for module in fused.modules())


def test_it_is_neither_trained_nor_saved(tmp_path):
    fused = models.fused(models.rgcnn("n-mnist"))
    assert not fused.training
    assert not any(parameter.requires_grad for parameter in fused.parameters())
    with pytest.raises(ValueError, match="the network is fused"):
        models.save(fused, tmp_path / "fused.safetensors")
