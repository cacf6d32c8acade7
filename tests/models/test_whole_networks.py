"""Graph networks as a whole against loops in float64 that are written from the thesis's text."""

from dataclasses import replace

import by_hand
import golden
import numpy as np
import pytest
import torch

from nvsdata import models

SMALL = {"channels": (3, 4, 5), "hidden": 6}
SETTINGS = {
    "as it is": {},
    "wide sensor": {"sensor_size": (60, 45), "clusters": ((4, 2), (8, 4), (32, 16))},
    "one block": {"channels": (3,), "clusters": ((7, 7),)},
    "kernel of 3": {"kernel_size": 3},
    "no loops": {"loops": False},
    "no root weight": {"root_weight": False},
    "average": {"pooling": "average"},
}


def checked(model, batch, expected):
    """The model gives these scores, which differ from sample to sample."""
    with torch.no_grad():
        found = model(batch).numpy()
    scale = np.abs(expected).max()
    assert found.shape == expected.shape
    assert np.abs(expected[0] - expected[1]).max() > 0.01 * scale
    assert np.abs(found - expected).max() < 1e-9 * scale


def network(kind, classes=3, **settings):
    return golden.fill(kind(classes, **settings).double())


@pytest.mark.parametrize("kind", [models.RGCNN, models.GCNN])
@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_graph_cnns_are_those_of_section_4_2(kind, settings):
    model = network(kind, **SMALL | settings)
    batch = wide(golden.graphs(model.sensor_size, nodes=40))
    residual = kind is models.RGCNN
    checked(model, batch, by_hand.graph_cnn(batch, by_hand.weights_of(model), model.settings, residual=residual))


@pytest.mark.parametrize("kind", ["abs", "signed-time"])
def test_other_pseudo_coordinates(kind):
    dim = 3 if kind == "signed-time" else 2
    model = network(models.RGCNN, **SMALL, dim=dim, kernel_size=3, in_channels=2)
    batch = wide(golden.graphs(model.sensor_size, nodes=30, kind=kind, features=2))
    checked(model, batch, by_hand.graph_cnn(batch, by_hand.weights_of(model), model.settings, residual=True))


@pytest.mark.parametrize("kind", [models.RGCNN, models.GCNN])
@pytest.mark.parametrize("name", models.CONVOLUTIONS)
def test_other_convolutions_stand_where_the_b_spline_did(kind, name):
    """test_conv.py has their own formulas; they get no edges from nodes to themselves, shortcuts do."""
    model = network(kind, **SMALL, convolution=name)
    batch = wide(golden.graphs(model.sensor_size, nodes=40))

    def convolution(batch, w, layer, size, loops):
        with torch.no_grad():
            return model.get_submodule(layer)(batch.x, batch.edge_index, batch.edge_attr).numpy()

    weights, residual = by_hand.weights_of(model), kind is models.RGCNN
    expected = by_hand.graph_cnn(batch, weights, model.settings, residual=residual, convolution=convolution)
    checked(model, batch, expected)


@pytest.mark.parametrize(
    ("temporal", "pooling"), [("plain", "max"), ("plain", "average"), ("inception", "max"), ("residual", "max")]
)
def test_graph_cnns_with_3d_cnns_are_those_of_section_5_3_1(temporal, pooling):
    settings = {"sensor_size": (40, 30), "channels": (3, 4), "clusters": ((4, 3), (8, 6)), "pooling": pooling}
    model = network(models.RGCNN3D, temporal=temporal, **settings)
    batch = wide(golden.sequences((40, 30), volumes=5, nodes=20))
    checked(model, batch, by_hand.graph_cnn3d(batch, by_hand.weights_of(model), model.settings))


def wide(batch):
    return replace(batch, x=batch.x.double())
