"""Matrix-LSTM against its definition: an LSTM cell at each pixel, event by event."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events
from nvsdata.data.ragged import EventBatch
from nvsdata.models import MatrixLSTM

LATE = 1_600_000_000_000_000
few = events(max_size=80, width=4, height=3)


def network(seed=0, **settings):
    torch.manual_seed(seed)
    return MatrixLSTM(**settings)


def by_definition(net, samples):
    """[B, bins C, H, W] in float64."""
    cell = torch.nn.LSTMCell(2, net.hidden).double()
    for name, weight in net.lstm.named_parameters():
        getattr(cell, name.removesuffix("_l0")).data[:] = weight.double()
    width, height = samples[0].sensor_size
    out = torch.zeros(len(samples), net.bins, net.hidden, height, width, dtype=torch.float64)
    for b, ev in enumerate(samples):
        pixels = {}
        for t, x, y, p in zip(*(column.tolist() for column in ev.columns), strict=True):
            share = (t - int(ev.t[0])) * net.bins // max(ev.duration, 1)
            pixels.setdefault((min(share, net.bins - 1), y, x), []).append((t, p))
        for (part, y, x), found in pixels.items():
            state = None
            delays = [0, *(after[0] - before[0] for before, after in zip(found, found[1:], strict=False))]  # noqa: RUF007
            for (_, p), delay in list(zip(found, delays, strict=True))[-net.most :]:
                given = torch.tensor([[2.0 * p - 1, delay / max(ev.duration, 1)]], dtype=torch.float64)
                state = cell(given, state)
            out[b, part, :, y, x] = state[0][0]
    return out.flatten(1, 2)


@settings(max_examples=30)
@given(
    samples=st.lists(few, min_size=1, max_size=3),
    seed=st.integers(0, 99),
    hidden=st.sampled_from((1, 3)),
    bins=st.sampled_from((1, 3)),
    most=st.sampled_from((1, 2, 512)),
)
def test_it_is_that_of_the_definition(samples, seed, hidden, bins, most):
    net = network(seed, hidden=hidden, bins=bins, most=most)
    found = net(EventBatch.of(samples))
    torch.testing.assert_close(found.double(), by_definition(net, samples), rtol=1e-5, atol=1e-6)
    late = [Events(ev.t + LATE, *ev.columns[1:], ev.sensor_size) for ev in samples]
    assert net(EventBatch.of(late)).equal(found)


def test_a_sample_does_not_depend_on_its_batch():
    one = Events([0, 5, 9], [1, 1, 2], [0, 0, 1], [1, 0, 1], (4, 3))
    other = Events([100, 5_000], [3, 3], [2, 2], [1, 1], (4, 3))
    net = network(bins=2)
    both = net(EventBatch.of([one, Events.empty((4, 3)), other]))
    assert both.shape == (3, 16, 3, 4)
    torch.testing.assert_close(both[:1], net(EventBatch.of([one])))
    torch.testing.assert_close(both[2:], net(EventBatch.of([other])))
    assert not both[1].any()
    assert net(EventBatch.of([Events.empty((4, 3))])).shape == (1, 16, 3, 4)


def test_its_weights_learn():
    rng = torch.Generator().manual_seed(0)
    samples = [
        Events(torch.arange(40).numpy() * 10, *torch.randint(0, 3, (2, 40), generator=rng).numpy(), p, (3, 3))
        for p in ([k % 2 for k in range(40)], [k % 3 > 0 for k in range(40)])
    ]
    net, head = network(), torch.nn.Linear(8, 2)
    optimizer = torch.optim.Adam([*net.parameters(), *head.parameters()], 0.05)
    for _ in range(60):
        loss = torch.nn.functional.cross_entropy(head(net(EventBatch.of(samples)).mean((2, 3))), torch.tensor([0, 1]))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss < 0.1
    assert all(weight.grad.abs().sum() > 0 for weight in net.parameters())


def test_settings_and_sensors_that_make_no_sense():
    for bad in ({"hidden": 0}, {"bins": 0}, {"most": 0}, {"bins": 1.5}):
        with pytest.raises(ValueError, match=next(iter(bad))):
            MatrixLSTM(**bad)
    two = [Events([1], [1], [1], [1], (4, 3)), Events([1], [1], [1], [1], (5, 3))]
    with pytest.raises(ValueError, match=r"several sensor sizes, 4x3, 5x3"):
        network()(EventBatch.of(two))
    assert "bins=1, most=512" in repr(MatrixLSTM())


def test_a_batch_without_events_has_gradients_of_zero():
    net = network()
    net(EventBatch.of([Events.empty((4, 3))])).sum().backward()
    assert all(weight.grad is None or not weight.grad.any() for weight in net.parameters())


def test_it_computes_in_the_type_of_its_weights():
    ev = Events([0, 5, 9], [1, 1, 2], [0, 0, 1], [1, 0, 1], (4, 3))
    net = network().double()
    found = net(EventBatch.of([ev]))
    assert found.dtype == torch.float64
    torch.testing.assert_close(found, by_definition(net, [ev]), rtol=1e-12, atol=1e-12)
