"""HOTS's surfaces and prototypes against their definition."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import events

from nvsdata.kernels.represent.hots import feature_surfaces, nearest_prototypes


def slow_surfaces(ev, feature, features, tau, radius):
    """exp(-(t - last) / tau) of the last event of each feature at each pixel around each event, itself included."""
    side, last, out = 2 * radius + 1, {}, []
    for i, (t, x, y) in enumerate(zip(ev.t.tolist(), ev.x.tolist(), ev.y.tolist(), strict=True)):
        last[feature[i], y, x] = t
        surface = np.zeros((features, side, side))
        for f in range(features):
            for r in range(side):
                for c in range(side):
                    at = last.get((f, y + r - radius, x + c - radius))
                    surface[f, r, c] = 0 if at is None else math.exp((at - t) / tau)
        out.append(surface)
    return np.array(out).reshape(-1, features, side, side)


@settings(max_examples=25)
@given(
    ev=events(max_size=50, width=6, height=5, gap=2_000),
    radius=st.integers(0, 3),
    features=st.integers(1, 3),
    seed=st.integers(0, 99),
)
def test_surfaces_and_prototypes_are_those_of_the_definition(ev, radius, features, seed):
    rng = np.random.default_rng(seed)
    feature, tau = rng.integers(0, features, len(ev)), 5_000.0
    expected = slow_surfaces(ev, feature, features, tau, radius)
    columns = (ev.t, ev.x, ev.y, feature, tau, radius)

    def scratch():
        return np.zeros((features, 5 + 2 * radius, 6 + 2 * radius))

    wanted = np.flatnonzero(rng.random(len(ev)) < 0.5)
    out = np.empty((wanted.size, features, 2 * radius + 1, 2 * radius + 1), np.float32)
    feature_surfaces(*columns, wanted, scratch(), out)
    np.testing.assert_allclose(out, expected[wanted], atol=1e-6)

    prototypes = rng.random((4, *expected.shape[1:]), np.float32)
    found = np.empty(len(ev), np.int64)
    nearest_prototypes(*columns, prototypes, scratch(), found)
    distances = ((expected[:, None] - prototypes) ** 2).sum((2, 3, 4))
    chosen = distances[np.arange(len(ev)), found]
    np.testing.assert_allclose(chosen, distances.min(1, initial=np.inf) if len(ev) else chosen, atol=1e-4)
