"""Networks that follow events: bad input, interrupted steps, threads, far times. Decisions: see tests/models."""

import copy
import pickle
import signal
import sys
import threading

import numpy as np
import pytest

from nvsdata.kernels.streaming.causal import CausalNetwork
from nvsdata.kernels.streaming.earlier import earlier_edges
from nvsdata.kernels.streaming.network import Layer, streaming_network
from nvsdata.kernels.streaming.sliding import SlidingNetwork

SIZE, UNITS, METRIC = (20, 16), 7, (3.0, 1.0, 1e-6)
CELLS = 3 * 3, 5  # cells of 7x7 pixels and channels


def layers(clusters, axes=2):
    rng, made, before = np.random.default_rng(0), [], 1
    for channels, cluster in zip((3, 4, 5), clusters, strict=True):
        weight = rng.normal(size=(3**axes + 1, before, channels)).astype(np.float32)
        bias = rng.normal(size=channels).astype(np.float32)
        made.append(Layer(weight, bias, 3, True, True, (3.0, 3.0, 3_000.0)[:axes], True, cluster, False))
        before = channels
    return made


def made_network(clusters, axes=2):
    hidden = np.random.default_rng(1).normal(size=(CELLS[0] * CELLS[1], UNITS)).astype(np.float32)
    return streaming_network(SIZE, METRIC, 4, layers(clusters, axes), hidden)


def sliding(axes=2):
    return SlidingNetwork(made_network(((2, 2), None, (7, 7)), axes), CELLS, UNITS)


def causal(axes=2):
    return CausalNetwork(made_network((None, None, (7, 7)), axes), None, CELLS, UNITS)


def columns(t, x, y):
    return np.array(t, np.int64), np.array(x, np.int16), np.array(y, np.int16), np.ones(len(t), np.uint8)


@pytest.mark.parametrize("make", [sliding, causal])
def test_events_that_a_state_cannot_trust_change_nothing(make):
    network = make()
    network.step(0, *columns([5, 5], [0, 19], [0, 15]))
    before = network.hidden
    for x, y in ((20, 0), (-1, 0), (0, 16), (0, -1)):
        with pytest.raises(ValueError, match="an event is outside the sensor"):
            network.step(0, *columns([6, 7], [1, x], [1, y]))
    for t in ([4], [7, 6], [-1]):
        with pytest.raises(ValueError, match="events must be in order of time, from 0 on"):
            network.step(0, *columns(t, [1] * len(t), [1] * len(t)))
    for n in range(4):
        uneven = list(columns([6, 6], [1, 1], [1, 1]))
        uneven[n] = uneven[n][:1]
        with pytest.raises(ValueError, match="columns of events must be equally long"):
            network.step(0, *uneven)
    for n, kind in enumerate((np.int32, np.int64, np.float32, np.int8)):
        other = list(columns([6], [1], [1]))
        other[n] = other[n].astype(kind)
        with pytest.raises(TypeError):
            network.step(0, *other)
    assert len(network) == 2
    assert np.array_equal(network.hidden, before)


@pytest.mark.parametrize("make", [sliding, causal])
@pytest.mark.parametrize("axes", [2, 3])
def test_times_and_windows_may_be_as_far_as_integers_go(make, axes):
    rng = np.random.default_rng(2)
    t = np.sort(rng.integers(0, 2**63 - 1, 900))
    t[0], t[-1] = 0, 2**63 - 2
    network = make(axes)
    for at in range(0, 900, 30):
        xy = rng.integers(0, SIZE, (30, 2)).astype(np.int16)
        network.step(-(2**63), t[at : at + 30], *xy.T.copy(), rng.integers(0, 2, 30).astype(np.uint8))
    assert len(network) == 900
    assert np.isfinite(network.hidden).all()
    network.step(2**63 - 2, *columns([], [], []))
    assert len(network) == 1
    assert network.shown.shape == CELLS


def test_pixels_that_fill_up_and_empty_leave_the_state_of_the_window():
    rng = np.random.default_rng(3)
    n, window = 3_000, 200
    t = np.cumsum(rng.integers(0, 20, n))
    # a spot that moves: its pixels need room for many events, and then for none
    step = np.arange(n) // 300
    x, y = (7 * step + rng.integers(0, 3, n)) % SIZE[0], (step + rng.integers(0, 3, n)) % SIZE[1]
    events = columns(t, x, y)
    network = sliding()
    for at in range(0, n, 50):
        network.step(t[max(at + 50 - window, 0)], *(c[at : at + 50] for c in events))
    fresh = sliding()
    fresh.step(0, *network.events())
    assert len(network) >= window
    assert np.allclose(network.hidden, fresh.hidden, rtol=1e-5)
    assert np.allclose(network.shown, fresh.shown, rtol=1e-5)


def test_weights_and_settings_that_do_not_fit():
    first = layers(((2, 2), None, (7, 7)))[:1]
    hidden = np.zeros((10 * 8 * 3, UNITS), np.float32)
    streaming_network(SIZE, METRIC, 4, first, hidden)
    for bad, message in (
        ({"size": 2}, "weights don't fit the kernel"),
        ({"size": 0}, "no such kernel"),
        ({"size": 2**20}, "no such kernel"),
        ({"bias": np.zeros(9, np.float32)}, "weights don't fit the kernel"),
        ({"reach": (1.0,)}, "no such kernel"),
        ({"reach": (1.0, 1e-60)}, "must not end at 0"),
        ({"reach": (1.0, float("nan"))}, "must not end at 0"),
        ({"cluster": (-1, 2)}, "no such clusters"),
        ({"cluster": (0, 2)}, "no such clusters"),
    ):
        with pytest.raises(ValueError, match=message):
            streaming_network(SIZE, METRIC, 4, [first[0]._replace(**bad)], hidden)
    for settings in (
        ((0, 16), METRIC, 4),
        ((2**40, 2**40), METRIC, 4),
        (SIZE, METRIC, 0),
        (SIZE, (3.0, 0.0, 0.0), 4),
        (SIZE, (float("nan"), 1.0, 0.0), 4),
        (SIZE, (3.0, 1.0, -1.0), 4),
    ):
        with pytest.raises(ValueError, match=r"no such|must be above 0"):
            streaming_network(*settings, first, hidden)
    with pytest.raises(ValueError, match="weights don't fit the last layer"):
        streaming_network(SIZE, METRIC, 4, first, hidden[1:])
    everywhere = layers((None, None, None))
    streaming_network(SIZE, METRIC, 4, everywhere, np.zeros((SIZE[0] * SIZE[1] * 5, UNITS), np.float32))
    with pytest.raises(ValueError, match="weights don't fit the last layer"):
        streaming_network(SIZE, METRIC, 4, everywhere, hidden)
    with pytest.raises(ValueError, match="without layers"):
        streaming_network(SIZE, METRIC, 4, [], hidden)
    with pytest.raises(ValueError, match="the first layer must be pooled"):
        SlidingNetwork(made_network((None, None, (7, 7))), CELLS, UNITS)
    averaged = layers((None, None, (7, 7)))
    averaged[-1] = averaged[-1]._replace(average=True)
    network = streaming_network(SIZE, METRIC, 4, averaged, np.zeros((CELLS[0] * CELLS[1], UNITS), np.float32))
    with pytest.raises(ValueError, match="the last layer must be pooled by maxima"):
        CausalNetwork(network, None, CELLS, UNITS)
    with pytest.raises(ValueError, match="only the last layer may be pooled"):
        CausalNetwork(made_network(((2, 2), None, (7, 7))), None, CELLS, UNITS)
    with pytest.raises(ValueError, match="the window must be at least 1"):
        CausalNetwork(made_network((None, None, (7, 7))), 0, CELLS, UNITS)


def test_arrays_of_another_size_are_not_filled():
    network = SlidingNetwork(made_network(((2, 2), None, (7, 7))), (1, 5), UNITS + 1)
    for read in (lambda: network.hidden, lambda: network.shown):
        with pytest.raises(ValueError, match="an array of another size is needed"):
            read()


@pytest.mark.skipif(sys.platform == "win32", reason="no such timer")
@pytest.mark.parametrize("make", [sliding, causal])
def test_a_step_that_was_interrupted_leaves_no_state(make):
    def stop(*_):
        raise KeyboardInterrupt

    network, n = make(), 2_000_000
    t, p = np.arange(n), np.ones(n, np.uint8)
    xy = np.random.default_rng(3).integers(0, 16, (2, n)).astype(np.int16)
    before = signal.signal(signal.SIGALRM, stop)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        with pytest.raises(KeyboardInterrupt):
            network.step(0, t, *xy, p)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    with pytest.raises(RuntimeError, match="a step of this network was interrupted"):
        network.step(0, *columns([], [], []))
    with pytest.raises(RuntimeError, match="a step of this network was interrupted"):
        len(network)


@pytest.mark.parametrize("make", [sliding, causal])
def test_threads_take_turns(make):
    network = make()

    def follow(seed):
        rng = np.random.default_rng(seed)
        for _ in range(100):
            network.step(0, *columns([10] * 5, *rng.integers(0, 16, (2, 5))))
            assert np.isfinite(network.hidden).all()

    threads = [threading.Thread(target=follow, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(network) == 2_000


@pytest.mark.parametrize("make", [sliding, causal])
@pytest.mark.parametrize("way", [pickle.dumps, copy.deepcopy])
def test_a_state_is_not_copied(make, way):
    for thing in (make(), made_network((None, None, (7, 7)))):
        with pytest.raises(TypeError, match="copy or pickle the network, and open the stream again"):
            way(thing)


def test_earlier_edges_of_columns_that_do_not_fit():
    t, x = np.zeros(3, np.int64), np.zeros(3, np.int32)
    assert earlier_edges(t, x, x, (1, 1), METRIC, 2).tolist() == [[0, 0, 1], [1, 2, 2]]
    # differences of times that no 64-bit number has
    far = np.array([-(2**63), 0, 2**63 - 1])
    assert earlier_edges(far, x, x, (1, 1), METRIC, 2).shape == (2, 0)
    with pytest.raises(ValueError, match="columns of events must be equally long"):
        earlier_edges(t, x[1:], x, (1, 1), METRIC, 2)
    for size, k in (((0, 1), 2), ((1, -1), 2), ((2**20, 2**20), 2), ((1, 1), 0)):
        with pytest.raises(ValueError, match="no such sensor or number of neighbors"):
            earlier_edges(t, x, x, size, METRIC, k)
    for off in (x + 1, x - 1):
        with pytest.raises(ValueError, match="an event is outside the sensor"):
            earlier_edges(t, off, x, (1, 1), METRIC, 2)
