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
        return T.radius_graph(Events(torch.arange(150).numpy() * 50, x, y, (x + y) % 2, sensor_size), **options)

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
    with pytest.raises(ValueError, match="it is fused"):
        models.save(fused, tmp_path / "fused.safetensors")
