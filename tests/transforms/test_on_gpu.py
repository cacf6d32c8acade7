import numpy as np
import pytest
import torch
from graphs import same

from nvsdata import Events, GraphBatch
from nvsdata.transforms import RadiusGraph
from nvsdata.transforms.graphs.on_gpu import pack, unpack

LAST = 2**32 - 1, 4095, 2047


def events(t, x, y, start=0):
    """Two events early at small places, and one at these."""
    size = max(x, 5) + 1, max(y, 7) + 1
    return Events([start, start, start + t], [0, 5, x], [7, 0, y], [1, 0, 1], size, start=start)


def test_events_take_7_bytes():
    random = np.random.default_rng(0)
    t = np.sort(random.integers(0, LAST[0], 500, endpoint=True))
    x, y = (random.integers(0, last, 500, endpoint=True) for last in LAST[1:])
    p = random.integers(0, 2, 500)
    samples = [Events(t, x, y, p, start=0), Events.empty((9, 9)), events(*LAST, start=10**15)]
    packed = pack(samples)
    assert packed.nbytes == 7 * 503
    found = unpack(torch.from_numpy(packed))
    first = ([0, 0, LAST[0]], [0, 5, LAST[1]], [7, 0, LAST[2]], [1, 0, 1])
    for column, values, more in zip(found, (t, x, y, p), first, strict=True):
        assert column.dtype == torch.int64
        assert column.tolist() == values.tolist() + more


@pytest.mark.parametrize("which", range(3))
def test_larger_numbers_are_left_to_the_cpu(which):
    assert pack([events(*LAST)]) is not None
    more = [value + (n == which) for n, value in enumerate(LAST)]
    assert pack([events(*more)]) is None
    assert pack([]) is None


@pytest.mark.parametrize("settings", [{}, {"causal": True}, {"alpha": 0.0}], ids=str)
def test_batches_are_the_graphs_of_each(settings):
    graph, samples = RadiusGraph(**settings), [events(10, 6, 1), events(20, 6, 1, 5)]
    assert same(graph.batch(samples), GraphBatch.from_graphs([graph(one) for one in samples]))


def test_a_batch_needs_samples():
    with pytest.raises(ValueError, match="at least one graph"):
        RadiusGraph().batch([])
