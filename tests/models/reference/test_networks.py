import pytest
import torch

from nvsdata.models import complexity
from nvsdata.models.reference import (
    C3D,
    I3D,
    LSTM,
    P3D,
    VGG,
    InceptionV4,
    MotionVector3D,
    PointNet,
    PointNet2,
    R2Plus1D,
    ResNet,
    ResNet3D,
    ResNeXt3D,
)
from nvsdata.models.reference.points import farthest_points

VIDEO = (16, 112, 112)


@pytest.mark.parametrize(
    ("kind", "classes", "millions"),
    [
        # as published, and as Tables 4.10 and 5.3 have them (there R(2+1)D of "36" layers)
        (VGG, 1000, 143.667),
        (InceptionV4, 1000, 42.680),
        (ResNet, 1000, 25.557),
        (C3D, 101, 78.41),
        (ResNet3D, 400, 63.72),
        (P3D, 400, 25.745),
        (R2Plus1D, 101, 33.22),
        (ResNeXt3D, 101, 26.07),
        (I3D, 101, 12.39),
    ],
)
def test_they_have_as_many_parameters_as_published(kind, classes, millions):
    with torch.device("meta"):
        model = kind(classes, in_channels=3)
    assert sum(p.numel() for p in model.parameters()) / 1e6 == pytest.approx(millions, abs=0.006)


@pytest.mark.parametrize(
    ("kind", "shape", "billions"),
    [
        # Tables 4.10, 4.6 and 5.3 count a multiplication and its addition as one
        (VGG, (224, 224), 19.63),
        (InceptionV4, (299, 299), 12.25),
        (ResNet, (224, 224), 3.87),
        (ResNet, (112, 112), 1.02),
        (R2Plus1D, VIDEO, 41.77),
    ],
)
def test_they_take_as_many_operations_as_the_tables_say(kind, shape, billions):
    with torch.device("meta"):
        model, sample = kind(101, in_channels=3), torch.empty(1, 3, *shape)
        counted = complexity(model, sample)
    assert counted.flops / 2e9 == pytest.approx(billions, rel=0.006)
    assert counted.executed == pytest.approx(counted.flops, rel=0.01)


@pytest.mark.parametrize("frames", [8, 16])
@pytest.mark.parametrize(
    ("kind", "size"), [(C3D, 112), (I3D, 224), (ResNet3D, 112), (P3D, 160), (R2Plus1D, 112), (ResNeXt3D, 112)]
)
def test_3d_networks_take_8_and_16_frames(kind, size, frames):
    with torch.device("meta"):
        model = kind(51).eval()
        assert model(torch.empty(2, 2, frames, size, size)).shape == (2, 51)
        assert model.features(torch.empty(2, 2, frames, size, size)).ndim == 5


SMALL = [
    (lambda: VGG(3, layers=16, in_channels=3, hidden=32), (3, 32, 32)),
    (lambda: InceptionV4(3), (2, 75, 75)),
    (lambda: ResNet(3), (2, 32, 32)),
    (lambda: C3D(3, hidden=32), (2, 8, 32, 32)),
    (lambda: I3D(3), (2, 8, 32, 32)),
    (lambda: ResNet3D(3, depths=(1, 1, 1, 1)), (2, 8, 32, 32)),
    (lambda: P3D(3), (2, 8, 32, 32)),
    (lambda: R2Plus1D(3, depths=(1, 1, 1, 1)), (2, 8, 32, 32)),
    (lambda: ResNeXt3D(3, depths=(1, 1, 1, 1)), (2, 8, 32, 32)),
    (lambda: MotionVector3D(3, frames=20, size=12, hidden=32), (1, 20, 12, 12)),
    (lambda: PointNet(3), (50, 4)),
    (lambda: PointNet2(3), (50, 4)),
    (lambda: LSTM(3, hidden=8), (50, 4)),
]


@pytest.mark.parametrize(("build", "shape"), SMALL)
def test_they_learn_and_a_sample_does_not_depend_on_its_batch(build, shape):
    model = build()
    x = torch.rand(3, *shape)
    # no sum of scores: batch normalization would leave that without gradients
    model(x).square().mul(torch.arange(1.0, 4.0).unsqueeze(1)).sum().backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in model.parameters())
    # float64: statistics of so few places magnify every rounding
    model, x = model.double().eval(), x.double()
    with torch.no_grad():
        together, alone = model(x), torch.cat([model(one.unsqueeze(0)) for one in x])
    assert together.shape == (3, 3)
    assert torch.allclose(together, alone, rtol=1e-6, atol=1e-6)
    assert complexity(model, x).uncounted == ()


def test_wrong_inputs_are_refused():
    with pytest.raises(ValueError, match=r"takes \[B, C, H, W\] with C = 2, not \[1, 3, 32, 32\]"):
        ResNet(3)(torch.rand(1, 3, 32, 32))
    with pytest.raises(ValueError, match=r"\[B, C, T, H, W\]"):
        ResNet3D(3, depths=(1, 1, 1, 1))(torch.rand(1, 2, 32, 32))
    with pytest.raises(ValueError, match="60x80 are too small"):
        InceptionV4(3)(torch.rand(1, 2, 80, 60))
    with pytest.raises(ValueError, match=r"volumes of \[20, 12, 12\]"):
        MotionVector3D(3, frames=20, size=12, hidden=8)(torch.rand(1, 1, 20, 12, 13))
    with pytest.raises(ValueError, match=r"points \[B, N, 4\]"):
        LSTM(3)(torch.rand(1, 10, 3))
    with pytest.raises(ValueError, match="layers must be one of"):
        VGG(3, layers=18)


@pytest.mark.parametrize("kind", [PointNet, PointNet2])
def test_the_order_of_points_does_not_matter(kind):
    points = torch.rand(2, 700, 4)
    model = kind(5).eval()
    shuffled = points[:, torch.randperm(700)]
    assert torch.allclose(model(points), model(shuffled), atol=1e-5)


def test_coinciding_points_give_finite_numbers():
    points = torch.zeros(2, 600, 4)
    for kind in (PointNet, PointNet2):
        scores = kind(3)(points)
        scores.sum().backward()
        assert scores.isfinite().all()


def test_farthest_points_are_those_of_the_definition():
    xyz = torch.rand(2, 60, 3, dtype=torch.float64)
    for cloud, chosen in zip(xyz, farthest_points(xyz, 12), strict=True):
        expected = [int((cloud - cloud.mean(0)).norm(dim=1).argmax())]
        while len(expected) < 12:
            expected.append(int(torch.cdist(cloud, cloud[expected]).amin(1).argmax()))
        assert chosen.tolist() == expected
