"""The thesis's networks in its own notation, read off their layers; nothing here is taken from the code.

A row is (source, what the code builds, what the source says).
"""

import pytest
import torch
from torch import nn

from nvsdata import models
from nvsdata.models.graph_cnn import ConvBlock, ResidualBlock
from nvsdata.models.temporal import Conv3D
from nvsdata.training.actions import Actions


def layers(network):
    """A network in the thesis's notation, read off its layers."""
    return " -> ".join(text for part in network.modules() for text in notation(part))


def notation(part):
    if isinstance(part, ResidualBlock):
        assert (part.conv.weight.shape[0], part.shortcut.weight.shape[0]) == (25, 1)  # kernels of 5x5 and 1x1: 4.2.5
        return [f"Res{tuple(part.conv.weight.shape[1:])}"]
    if isinstance(part, ConvBlock):
        assert part.conv.weight.shape[0] == 25
        return [f"Conv{tuple(part.conv.weight.shape[1:])}"]
    if isinstance(part, models.GraphPool):
        return [f"{part.mode.capitalize()}P{part.cluster}"]
    if isinstance(part, nn.Linear):
        return [f"FC({part.out_features})"]
    if type(part).__name__ == "Dropout":
        return [f"Dropout({part.p})"]
    return []


def grids(network):
    """The 3D CNN: kernels of convolutions with their channels, strides of poolings of 2 x 2 x 2."""
    found = []
    for part in network.temporal.modules():
        if isinstance(part, nn.Conv3d):
            assert part.stride == (1, 1, 1)
            found.append(f"{part.kernel_size[0]}:{part.in_channels},{part.out_channels}")
        elif isinstance(part, nn.MaxPool3d) and part.kernel_size == 2:
            found.append("pool{}{}{}".format(*part.stride))
    assert all(isinstance(p[2], nn.ReLU) for p in network.temporal.modules() if isinstance(p, Conv3D))
    return " ".join(found)


SMALL = "Conv(1, 32) -> MaxP(2, 2) -> Res(32, 64) -> MaxP(4, 4) -> Res(64, 128) -> MaxP(7, 7)"
SMALL += " -> FC(128) -> Dropout(0.5) -> FC(10)"
WIDE = "Conv(1, 64) -> MaxP{} -> Res(64, 128) -> MaxP{} -> Res(128, 256) -> MaxP{} -> Res(256, 512) -> MaxP{}"
WIDE += " -> FC(1024) -> Dropout(0.5) -> FC({})"
DAVIS = (4, 3), (16, 12), (30, 23), (60, 45)
SQUARE = (4, 4), (6, 6), (20, 20), (32, 32)
PLAIN = "Conv(1, 32) -> MaxP(2, 2) -> Conv(32, 64) -> MaxP(4, 4) -> Conv(64, 128) -> MaxP(7, 7)"
PLAIN += " -> FC(128) -> Dropout(0.5) -> FC(10)"
GESTURES = "Res(1, 64) -> MaxP(2, 2) -> Res(64, 128) -> MaxP(4, 4) -> FC(11)"
ACTIONS = "Res(1, 32) -> MaxP(2, 2) -> Res(32, 64) -> MaxP(4, 3) -> Res(64, 128) -> MaxP(8, 6) -> FC({})"


def depth(number, **settings):
    """Output channels, clusters and hidden layer: of Table 4.4, or of a network for 34x34."""
    settings = settings or {"sensor_size": (240, 180), "hidden": 1024, **models.DEPTHS[number]}
    network = models.GCNN(101, **settings)
    pools = [part.cluster for part in network.modules() if isinstance(part, models.GraphPool)]
    widths = [part.conv.weight.shape[2] for part in network.modules() if isinstance(part, ConvBlock)]
    return widths, pools, network.hidden.out_features


NETWORKS = [
    ("4.4.2", lambda: layers(models.rgcnn("n-mnist")), SMALL),
    ("4.4.2", lambda: layers(models.rgcnn("mnist-dvs")), SMALL),
    ("4.4.2, plain", lambda: layers(models.gcnn("n-mnist")), PLAIN),
    ("4.4.2", lambda: layers(models.rgcnn("cifar10-dvs")), WIDE.format(*SQUARE, 10)),
    ("4.4.2", lambda: layers(models.rgcnn("n-cars")), WIDE.format(*SQUARE, 2)),
    ("4.4.2", lambda: layers(models.rgcnn("n-caltech101")), WIDE.format(*DAVIS, 101)),
    ("4.4.2", lambda: layers(models.rgcnn("asl-dvs")), WIDE.format(*DAVIS, 24)),
    ("no others", lambda: len(models.CONFIGURATIONS), 6),
    ("4.4.1: D = 2", lambda: depth(2), ([128, 256], [(16, 12), (60, 45)], 1024)),
    ("4.4.1: D = 3", lambda: depth(3), ([64, 128, 256], [(8, 6), (16, 12), (60, 45)], 1024)),
    ("4.4.1: D = 4", lambda: depth(4), ([64, 128, 256, 512], [*DAVIS], 1024)),
    (
        "4.4.1: D = 5",
        lambda: depth(5),
        ([64, 128, 256, 512, 512], [(4, 3), (8, 6), (16, 12), (30, 23), (60, 45)], 1024),
    ),
    (
        "4.4.1: D = 6",
        lambda: depth(6),
        ([64, 128, 256, 512, 512, 512], [(2, 2), (4, 3), (8, 6), (16, 12), (30, 23), (60, 45)], 1024),
    ),
    ("departures.md", lambda: depth(4, **models.SMALL_DEPTHS[4]), ([32, 64, 64, 128], [(2, 2), (4, 4), (7, 7)], 128)),
    (
        "departures.md: N-MNIST",
        lambda: depth(5, **models.SMALL_DEPTHS[5]),
        ([32, 64, 64, 128, 128], [(2, 2), (4, 4), (7, 7)], 128),
    ),
    ("4.4.2", lambda: models.SMALL_DEPTHS[3].items() <= models.CONFIGURATIONS["n-mnist"].items(), True),
    ("Table 4.4: no others", lambda: sorted(models.DEPTHS), [2, 3, 4, 5, 6]),
    ("5.3.1", lambda: layers(models.rgcnn3d("dvs128-gesture", "plain")), GESTURES),
    ("5.3.1", lambda: layers(models.rgcnn3d("ucf101-dvs", "plain")), ACTIONS.format(101)),
    ("5.3.1", lambda: layers(models.rgcnn3d("hmdb51-dvs", "plain")), ACTIONS.format(51)),
    (
        "5.3.1, Plain 3D",
        lambda: grids(models.rgcnn3d("ucf101-dvs", "plain")),
        "3:128,128 pool122 3:128,256 pool222 3:256,512 pool222 3:512,512 pool222",
    ),
    (
        "5.3.1, Inception-3D(4)",
        lambda: grids(models.rgcnn3d("ucf101-dvs", "inception")),
        "1:128,128 1:128,128 3:128,192 1:128,32 3:32,96 1:128,64 pool122 "
        "1:480,192 1:480,96 3:96,208 1:480,16 3:16,48 1:480,64 pool222 "
        "1:512,160 1:512,112 3:112,224 1:512,24 3:24,64 1:512,64 pool222 "
        "1:512,128 1:512,128 3:128,256 1:512,24 3:24,64 1:512,64 pool222",
    ),
    (
        "5.3.1, Residual 3D",
        lambda: grids(models.rgcnn3d("ucf101-dvs")),
        "3:128,256 3:256,512 1:128,512 pool122 3:512,512 3:512,1024 1:512,1024 pool222",
    ),
    ("5.3.1: 128x128", lambda: layers(Actions().build((128, 128), 11)), GESTURES),
    ("5.3.1: 240x180", lambda: layers(Actions().build((240, 180), 101)), ACTIONS.format(101)),
]


@pytest.mark.parametrize(("source", "built", "said"), NETWORKS, ids=[f"{n} {row[0]}" for n, row in enumerate(NETWORKS)])
def test_the_network_is_that_of(source, built, said):
    assert built() == said


def test_the_full_layers_of_the_network_for_motion_vectors_drop_most():
    """3.5.1 and 3.5.2: dropout of 0.8 in the first two fully connected layers."""
    made = models.reference.MotionVector3D(50)
    assert [part.p for part in made.modules() if type(part).__name__ == "Dropout"] == [0.8, 0.8]


def test_batch_normalization_is_torchs():
    """(4.7) leaves its epsilon open; torch's is taken."""
    norm = models.BatchNorm(3)
    assert (norm.eps, norm.weight.tolist(), norm.bias.tolist()) == (1e-5, [1, 1, 1], [0, 0, 0])
    assert torch.equal(norm.running_var, torch.ones(3))
