"""PointNet, PointNet++ and LSTM against loops in float64, written from their papers (thesis Table 5.1)."""

import golden
import numpy as np
import pytest
import torch
from by_hand import full, normalized, weights_of

from nvsdata.models.reference import LSTM, PointNet, PointNet2


def network(kind, **settings):
    return golden.fill(kind(3, **settings).double())


def given(count):
    return golden.points(count).double()


def checked(model, points, by_hand):
    weights = weights_of(model)
    expected = np.stack([by_hand(cloud.numpy(), weights) for cloud in points])
    with torch.no_grad():
        found = model(points).numpy()
    scale = np.abs(expected).max()
    assert np.abs(expected[0] - expected[1]).max() > 0.01 * scale
    assert np.abs(found - expected).max() < 1e-9 * scale


def shared(x, w, name):
    """The same fully connected layers without bias for each point, each normalized and activated; [N, C] to [N, C']."""
    layer = 0
    while f"{name}.{layer}.0.weight" in w:
        matrix = w[f"{name}.{layer}.0.weight"][:, :, 0, 0]
        x = np.maximum(normalized(x @ matrix.T, w, f"{name}.{layer}.1"), 0)
        layer += 1
    return x


def head(x, w, name):
    """Fully connected layers, all but the last normalized and activated."""
    for first in (0, 3):
        x = np.maximum(normalized(full(x, w, f"{name}.{first}"), w, f"{name}.{first + 1}"), 0)
    return full(x, w, f"{name}.7")


def aligned(x, w, name):
    """Points times a matrix that depends on all of them, which is the identity and what is learned."""
    size = x.shape[1]
    matrix = head(shared(x, w, f"{name}.points").max(0), w, f"{name}.matrix").reshape(size, size) + np.eye(size)
    return np.stack([matrix @ point for point in x])


def test_pointnet():
    def by_hand(x, w):
        x = shared(aligned(x, w, "points.0"), w, "points.1")
        x = shared(aligned(x, w, "points.2"), w, "points.3")
        return head(x.max(0), w, "classify")

    checked(network(PointNet), given(50), by_hand)


def abstracted(xyz, features, w, name, centers, radius, most):
    """Centers far from each other; around each the nearest points within a ball, as seen from it, and their maximum."""
    chosen = [int(np.linalg.norm(xyz - xyz.mean(0), axis=1).argmax())]
    nearest = np.linalg.norm(xyz - xyz[chosen[0]], axis=1)
    while len(chosen) < min(centers, len(xyz)):
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(xyz - xyz[chosen[-1]], axis=1))
    out, sizes = [], []
    for center in xyz[chosen]:
        apart = np.linalg.norm(xyz - center, axis=1)
        near = [n for n in np.argsort(apart) if apart[n] <= radius][:most]
        sizes.append(len(near))
        out.append(shared(np.hstack((xyz[near] - center, features[near])), w, f"{name}.mlp").max(0))
    return xyz[chosen], np.stack(out), sizes


@pytest.mark.parametrize("count", [100, 700])
def test_pointnet2(count):
    sizes = []

    def by_hand(x, w):
        xyz, features, first = abstracted(x[:, :3], x[:, 3:], w, "first", 512, 0.2, 32)
        xyz, features, second = abstracted(xyz, features, w, "second", 128, 0.4, 64)
        sizes.extend((first, second))
        return head(shared(np.hstack((xyz, features)), w, "whole").max(0), w, "classify")

    checked(network(PointNet2), given(count), by_hand)
    # with 700, some balls have fewer points than are taken at most, and others more
    assert min(map(min, sizes[::2])) < 32
    assert min(map(min, sizes[1::2])) < 64
    assert count == 100 or all(max(of_one) == most for of_one, most in zip(sizes, (32, 64, 32, 64), strict=True))


def sigmoid(x):
    return 1 / (1 + np.exp(-x))


@pytest.mark.parametrize("layers", [1, 2])
def test_lstm(layers):
    """Event by event, each layer hearing the one below; the last state of the last one is what counts."""
    size = 7

    def by_hand(events, w):
        state, cell = np.zeros((2, layers, size))
        for event in events:
            heard = event
            for n in range(layers):
                parts = w[f"lstm.weight_ih_l{n}"] @ heard + w[f"lstm.bias_ih_l{n}"]
                parts = parts + w[f"lstm.weight_hh_l{n}"] @ state[n] + w[f"lstm.bias_hh_l{n}"]
                enter, forget, new, leave = parts.reshape(4, size)
                cell[n] = sigmoid(forget) * cell[n] + sigmoid(enter) * np.tanh(new)
                state[n] = heard = sigmoid(leave) * np.tanh(cell[n])
        return full(state[-1], w, "classify")

    checked(network(LSTM, hidden=size, layers=layers), given(30), by_hand)
