"""Networks on a pretended device: forward, backward and running statistics are those of the CPU."""

from dataclasses import replace

import pytest
import torch
from elsewhere import Elsewhere, Factories
from torch.func import functional_call

from nvsdata import Events, GraphBatch, collate, models
from nvsdata import transforms as T
from nvsdata.models.reference import LSTM, PointNet, PointNet2

SIZE = (34, 34)
SMALL = {"channels": (4, 6), "clusters": ((4, 4), (8, 8)), "sensor_size": SIZE}


def graphs(count, volumes=None):
    """A batch of graphs, one without nodes, in float64."""
    samples = []
    for n in range(count * (volumes or 1)):
        generator = torch.Generator().manual_seed(n)
        nodes = 0 if n == 1 else 120
        x, y = (torch.randint(0, side, (nodes,), generator=generator).numpy() for side in SIZE)
        samples.append(T.RadiusGraph(radius=6)(Events(range(nodes), x, y, x % 2, SIZE)))
    if volumes:
        samples = [samples[n * volumes : (n + 1) * volumes] for n in range(count)]
    batch = collate([(sample, 0) for sample in samples]).inputs
    return replace(batch, x=batch.x.double(), edge_attr=batch.edge_attr.double())


CASES = {
    "rgcnn": lambda: (models.RGCNN(3, **SMALL), graphs(4)),
    "average": lambda: (models.RGCNN(3, **SMALL, pooling="average"), graphs(4)),
    "rgcnn3d": lambda: (models.RGCNN3D(3, **SMALL, temporal="plain"), graphs(2, 4)),
    **{name: lambda name=name: (models.GCNN(3, **SMALL, convolution=name), graphs(4)) for name in models.CONVOLUTIONS},
    "pointnet": lambda: (PointNet(3), torch.rand(3, 64, 4, dtype=torch.float64)),
    "pointnet2": lambda: (PointNet2(3), torch.rand(3, 64, 4, dtype=torch.float64)),
    "lstm": lambda: (LSTM(3), torch.rand(3, 64, 4, dtype=torch.float64)),
}


def moved(sample):
    return sample._each(Elsewhere) if isinstance(sample, GraphBatch) else Elsewhere(sample)


@pytest.mark.parametrize("name", CASES)
def test_networks_agree_with_the_cpu(name):
    model, sample = CASES[name]()
    model.double().train()
    for part in model.modules():
        if "Dropout" in type(part).__name__:
            part.eval()
    parameters = dict(model.named_parameters())
    start = {k: v.detach().clone() for k, v in (*parameters.items(), *model.named_buffers())}
    scores = model(sample)
    scores.square().sum().backward()
    with Factories():
        there = {k: Elsewhere(v).requires_grad_(k in parameters) for k, v in start.items()}
        found = functional_call(model, there, (moved(sample),))
        found.square().sum().backward()
    assert isinstance(found, Elsewhere)
    torch.testing.assert_close(found.detach().value, scores.detach(), rtol=1e-9, atol=1e-9)
    largest = max(float(p.grad.abs().max()) for p in parameters.values())
    for k, parameter in parameters.items():
        torch.testing.assert_close(there[k].grad.value, parameter.grad, rtol=0, atol=1e-9 * largest)
    for k, buffer in model.named_buffers():
        torch.testing.assert_close(there[k].value, buffer, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("there", [False, True], ids=["cpu", "elsewhere"])
@pytest.mark.parametrize("name", [*CASES, "fused"])
def test_what_is_nan_comes_out_as_nan(name, there):
    model, sample = CASES["rgcnn" if name == "fused" else name]()
    model.double().eval()
    if name == "fused":
        model = models.fused(model)
    (sample.x[5] if isinstance(sample, GraphBatch) else sample[0, 5, 3:]).fill_(torch.nan)
    state = dict(model.named_parameters()) | dict(model.named_buffers())
    with torch.no_grad(), Factories():
        if there:
            state = {k: Elsewhere(v) for k, v in state.items()}
            scores = functional_call(model, state, (moved(sample),)).value
        else:
            scores = model(sample)
    assert scores[0].isnan().all()
    assert scores[1:].isfinite().all()


def test_places_that_are_nan_are_no_indices_elsewhere():
    """The CPU refuses them where they would become edges; on a GPU a wrong index would end the process's use of it."""
    model, sample = CASES["rgcnn"]()
    model.double().eval()
    sample.pos[5] = torch.nan
    with pytest.raises(ValueError, match="not finite"):
        model(sample)
    sample.edge_attr[7] = torch.nan
    state = dict(model.named_parameters()) | dict(model.named_buffers())
    with torch.no_grad(), Factories():
        scores = functional_call(model, {k: Elsewhere(v) for k, v in state.items()}, (moved(sample),)).value
    assert scores[0].isnan().all()
    assert scores[1:].isfinite().all()


def test_the_pretended_device_is_one_apart():
    away = Elsewhere(torch.ones(3))
    with pytest.raises(AssertionError, match="two devices"):
        away + torch.ones(3)
    with pytest.raises(TypeError, match="numpy"):
        away.numpy()
    with Factories():
        assert isinstance(torch.zeros(3, device=away.device) + away, Elsewhere)
