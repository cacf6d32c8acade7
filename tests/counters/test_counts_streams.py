"""Work of steps of streaming networks, in elements that the kernels touch."""

import numpy as np
import pytest
import torch

from nvsdata import models
from nvsdata import transforms as T
from nvsdata.data.events import Columns
from nvsdata.kernels import _native
from nvsdata.models.incremental.network import IncrementalCausalNetwork, IncrementalNetwork, NetworkLayers

pytestmark = pytest.mark.skipif(not _native.checks_bounds, reason="only a build that checks indices counts them")
SMALL = {"channels": (4, 6, 5), "hidden": 9, "sensor_size": (128, 128)}


def touched(live, events, window, some):
    """Elements touched by steps of one event each, once the window is full."""
    start = events.t.size - some
    live.step(-(2**62), *events.take(slice(0, start)))
    _ = live.hidden, _native.touched()
    for n in range(start, events.t.size):
        live.step(int(events.t[n]) - window + 1, *events.take(slice(n, n + 1)))
        assert live.hidden.size == 9
    return _native.touched() / some


def events_of(count, gap):
    rng = np.random.default_rng(0)
    xy = rng.integers(0, 128, (2, count)).astype(np.int16)
    return Columns(np.arange(count) * gap, *xy, rng.integers(0, 2, count).astype(np.uint8))


@pytest.mark.parametrize("causal", [False, True])
def test_a_step_of_one_event_costs_the_same_however_many_the_window_has(causal):
    torch.manual_seed(0)
    clusters = (None, None, (32, 32)) if causal else ((2, 2), (8, 8), (32, 32))
    graph = T.RadiusGraph(max_degree=8, causal=causal)
    network = models.RGCNN(3, clusters=clusters, **SMALL).eval()
    found = []
    # as many events near each, of equal times apart
    for count in (4_000, 16_000):
        parts, window = NetworkLayers(network, graph), 10 * (count - 200)
        live = IncrementalCausalNetwork(parts, window) if causal else IncrementalNetwork(parts)
        found.append(touched(live, events_of(count, 10), window, 100))
    assert found[1] < 2 * found[0]


@pytest.mark.parametrize("size", [(128, 1_024), (1_024, 128)])
def test_a_step_of_one_event_costs_the_same_however_large_the_sensor_is(size):
    graph, found = T.RadiusGraph(max_degree=8), []
    for sensor_size in ((128, 128), size):
        torch.manual_seed(0)
        # the last clusters are as many
        clusters = ((2, 2), (8, 8), tuple(side // 4 for side in sensor_size))
        network = models.RGCNN(3, clusters=clusters, **SMALL | {"sensor_size": sensor_size}).eval()
        found.append(touched(IncrementalNetwork(NetworkLayers(network, graph)), events_of(2_000, 10), 10_000, 100))
    assert found[1] < 1.5 * found[0]
