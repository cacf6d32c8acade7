"""Spikes of H-First against its definition, neuron by neuron."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import events

from nvsdata.kernels.represent.hfirst import Neuron, spike_counts

FAR = 2**62 - 1_000_000


def leaked(potential, neuron, duration):
    """The potential after `duration` µs."""
    size = np.maximum(np.abs(potential) - np.float32(duration * neuron.leak), np.float32(0))
    return np.copysign(size, potential)


def spike_of(layer, place, weights, neuron, t):
    """Add weights to the neurons at a place, and return the one that spikes, or None."""
    state = layer.setdefault(place, {"potentials": np.zeros(len(weights), np.float32), "time": t, "spike": None})
    if state["spike"] is not None and t - state["spike"] < neuron.refractory:
        return None
    state["potentials"] = leaked(state["potentials"], neuron, t - state["time"]) + weights
    state["time"] = t
    if not len(weights) or state["potentials"].max() <= neuron.threshold:
        return None
    strongest = int(state["potentials"].argmax())
    state["potentials"] = np.zeros(len(weights), np.float32)
    state["spike"] = t
    return strongest


def slow_spike_counts(ev, filters, simple, cell, pause, templates, classes):
    (width, height), radius = ev.sensor_size, filters.shape[1] // 2
    counts = np.zeros((len(filters), -(-height // cell), -(-width // cell)), np.int64)
    votes, s1, c1, s2 = np.zeros(len(templates), np.int64), {}, {}, {}
    for t, x, y, p in zip(*(column.tolist() for column in ev.columns), strict=True):
        for r in range(height):
            for c in range(width):
                if max(abs(r - y), abs(c - x)) > radius:
                    continue
                k = spike_of(s1, (p, r, c), filters[:, y - r + radius, x - c + radius], simple, t)
                if k is None:
                    continue
                complex_cell = k, r // cell, c // cell
                if complex_cell in c1 and t - c1[complex_cell] < pause:
                    continue
                c1[complex_cell] = t
                counts[complex_cell] += 1
                chosen = spike_of(s2, "all", templates[(slice(None), *complex_cell)], classes, t)
                if chosen is not None:
                    votes[chosen] += 1
    return counts, votes


neurons = st.builds(
    Neuron, st.sampled_from((0.5, 3.0, 9.0)), st.sampled_from((0.0, 0.001, 0.02)), st.sampled_from((0, 1, 300, 2**62))
)


@settings(max_examples=60)
@given(
    ev=events(max_size=120, width=7, height=6, gap=300),
    shift=st.sampled_from((0, -FAR, FAR)),
    filters=st.sampled_from((0, 1, 3, 17)),
    radius=st.integers(0, 4),  # up to larger than the sensor
    simple=neurons,
    cell=st.integers(1, 9),
    pause=st.sampled_from((0, 1, 200, 2**62)),
    classes=neurons,
    count=st.integers(0, 3),
    seed=st.integers(0, 99),
)
def test_spikes_are_those_of_the_definition(ev, shift, filters, radius, simple, cell, pause, classes, count, seed):
    rng, (width, height) = np.random.default_rng(seed), ev.sensor_size
    weights = rng.normal(1, 2, (filters, 2 * radius + 1, 2 * radius + 1)).astype(np.float32)
    templates = rng.normal(1, 2, (count, filters, -(-height // cell), -(-width // cell))).astype(np.float32)
    ev = type(ev)(ev.t + shift, *ev.columns[1:], ev.sensor_size)
    settings = weights, simple, cell, pause, templates, classes
    found = spike_counts(*ev.columns, ev.sensor_size, *settings)
    for one, expected in zip(found, slow_spike_counts(ev, *settings), strict=True):
        np.testing.assert_array_equal(one, expected)


def one_pixel(*times):
    return np.array(times, np.int64), *np.zeros((2, len(times)), np.int16), np.ones(len(times), np.uint8)


ANY = Neuron(1, 0, 0)


def spikes(times, simple, pause=0, filters=((5.0,),), templates=((9.0,),), classes=ANY):
    """Counts of complex cells and classes of one pixel, with filters and templates of a value each."""
    weights, values = (np.array(one, np.float32) for one in (filters, templates))
    counts, votes = spike_counts(
        *one_pixel(*times), (1, 1), weights[:, :, None], simple, 1, pause, values[:, :, None, None], classes
    )
    return counts.ravel().tolist(), votes.tolist()


def test_potentials_add_up_and_leak_and_the_threshold_is_exceeded():
    assert spikes([0, 0], Neuron(10, 1, 0)) == ([0], [0])
    assert spikes([0, 0, 0], Neuron(10, 1, 0)) == ([1], [1])
    assert spikes([0, 4, 8], Neuron(10, 1, 0)) == ([0], [0])
    assert spikes([0, 4, 4], Neuron(10, 1, 0)) == ([1], [1])
    # negative potentials leak towards 0, too, and not beyond
    assert spikes([0, 100], Neuron(4, 1, 0), filters=[[-5.0]]) == ([0], [0])


def test_spikes_are_followed_by_a_refractory_period_and_a_pause():
    assert spikes([0, 9, 10, 19, 20], Neuron(4, 0, 10)) == ([3], [3])
    assert spikes([0, 9, 10, 19, 20], Neuron(4, 0, 0), pause=10) == ([3], [3])
    assert spikes([0, 9, 10, 19, 20], Neuron(4, 0, 0), classes=Neuron(1, 0, 10)) == ([5], [3])


def test_the_strongest_neuron_resets_the_others():
    assert spikes([0, 0, 0], Neuron(4, 0, 0), filters=[[4.5], [6.0], [6.0]], templates=[[1, 1, 1]]) == (
        [0, 3, 0],
        [1],
    )
    found = spikes([0, 0, 0, 0], Neuron(4, 0, 0), templates=[[0.6], [0.9]])
    assert found == ([4], [0, 2])


def test_either_polarity_has_neurons_of_its_own():
    t, x, y, _ = one_pixel(0, 0, 0)
    filters, none = np.full((1, 1, 1), 4, np.float32), np.zeros((0, 1, 1, 1), np.float32)
    for p, expected in (([0, 0, 0], 1), ([0, 1, 0], 1), ([1, 0, 1], 1)):
        polarity = np.array(p, np.uint8)
        rest = (1, 1), filters, Neuron(7, 0, 9), 1, 0, none, ANY
        assert spike_counts(t, x, y, polarity, *rest)[0].sum() == expected
    assert spike_counts(t[:2], x[:2], y[:2], np.array([0, 1], np.uint8), *rest)[0].sum() == 0


def test_no_events_have_no_spikes():
    assert spikes([], ANY) == ([0], [0])


@pytest.mark.parametrize(
    ("simple", "count", "side", "cell", "pause"),
    [
        (Neuron(0, 0, 0), 1, 1, 1, 0),
        (Neuron(float("nan"), 0, 0), 1, 1, 1, 0),
        (Neuron(1, -1, 0), 1, 1, 1, 0),
        (Neuron(1, 0, -1), 1, 1, 1, 0),
        (Neuron(1, float("inf"), 0), 1, 1, 1, 0),
        (ANY, 1, 2, 1, 0),
        (ANY, 1, 1, 2**15 + 1, 0),
        (ANY, 1, 1, 1, -1),
    ],
)
def test_impossible_settings_are_refused(simple, count, side, cell, pause):
    filters, templates = np.ones((count, side, side), np.float32), np.ones((1, count, 1, 1), np.float32)
    with pytest.raises(ValueError, match=r"spike_counts\(\): "):
        spike_counts(*one_pixel(0), (1, 1), filters, simple, cell, pause, templates, ANY)
