"""EST against its definition: the kernel evaluated for every event and channel."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import Events
from nvsdata.data.ragged import EventBatch
from nvsdata.models import EST

LATE = 1_600_000_000_000_000
few = events(max_size=60, width=5, height=4)


def random_est(seed, bins, hidden):
    torch.manual_seed(seed)
    net = EST(bins, hidden)
    for parameter in net.parameters():
        torch.nn.init.normal_(parameter, std=0.6)
    return net


def by_definition(net, samples):
    """[B, 2 C, H, W] in float64, event by event."""
    width, height = samples[0].sensor_size
    out = torch.zeros(len(samples), 2 * net.bins, height, width, dtype=torch.float64)
    places, values = [], []
    for b, ev in enumerate(samples):
        for t, x, y, p in zip(*(column.tolist() for column in ev.columns), strict=True):
            share = (t - int(ev.t[0])) / max(ev.duration, 1)
            for c in range(net.bins):
                u = torch.tensor(share - c / max(net.bins - 1, 1), dtype=torch.float64)
                places.append((b, p * net.bins + c, y, x))
                values.append(share * net.kernel(u))
    if not places:
        return out
    index = tuple(torch.tensor(axis) for axis in zip(*places, strict=True))
    return out.index_put(index, torch.stack(values), accumulate=True)


@settings(max_examples=25)
@given(
    samples=st.lists(few, min_size=1, max_size=3),
    seed=st.integers(0, 99),
    bins=st.sampled_from((1, 2, 5)),
    hidden=st.sampled_from(((6,), (8, 7), (7, 6, 9))),
)
def test_it_is_that_of_the_definition(samples, seed, bins, hidden):
    net = random_est(seed, bins, hidden)
    found, expected = net(EventBatch.of(samples)), by_definition(net, samples)
    torch.testing.assert_close(found.double(), expected, rtol=1e-5, atol=1e-5)
    late = [Events(ev.t + LATE, *ev.columns[1:], ev.sensor_size) for ev in samples]
    assert net(EventBatch.of(late)).equal(found)
    weights = torch.randn(found.shape, generator=torch.Generator().manual_seed(seed))
    parameters = list(net.parameters())
    if not sum(map(len, samples)):
        return
    gradients = torch.autograd.grad((found * weights).sum(), parameters)
    wanted = torch.autograd.grad((expected * weights).sum(), parameters)
    scale = max(gradient.abs().max() for gradient in wanted)
    for gradient, other in zip(gradients, wanted, strict=True):
        torch.testing.assert_close(gradient, other, rtol=1e-4, atol=1e-5 * float(scale) + 1e-6)


@pytest.mark.parametrize("hidden", [(6,), (30, 30), (8, 9, 10)])
@pytest.mark.parametrize("bins", [1, 2, 9])
def test_the_kernel_begins_as_the_trilinear_one(bins, hidden):
    u = torch.linspace(-1, 1, 401, dtype=torch.float64)
    width = max(bins - 1, 1)
    expected = (1 - width * u.abs()).clamp(min=0)
    torch.testing.assert_close(EST(bins, hidden).kernel(u), expected, rtol=0, atol=1e-5)


def test_it_learns_a_kernel():
    torch.manual_seed(0)
    net, goal = EST(4, (12, 12)), random_est(5, 4, (6,))
    rng = np.random.default_rng(0)
    ev = Events(np.sort(rng.integers(0, 10_000, 400)), *(rng.integers(0, n, 400) for n in (4, 3, 2)), (4, 3))
    batch = EventBatch.of([ev])
    with torch.no_grad():
        wanted = goal(batch)
    optimizer = torch.optim.Adam(net.parameters(), lr=1e-2)
    losses = []
    for _ in range(150):
        loss = (net(batch) - wanted).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.02 * losses[0]


def test_it_takes_what_collate_gives():
    samples = [(Events([0, 5], [1, 2], [0, 1], [1, 0], (4, 3)), 0), (Events.empty((4, 3)), 1)]
    batch, _ = nvsdata.collate(samples, events="columns")
    found = EST(3)(batch).detach()
    assert found.shape == (2, 6, 3, 4)
    # the first event's share is 0, and the last one's all in the last channel of OFF
    assert (found.abs() > 1e-6).nonzero().tolist() == [[0, 2, 1, 2]]
    assert found[0, 2, 1, 2] == pytest.approx(1, abs=1e-6)


def test_wrong_settings_and_samples():
    for make, reason in (
        (lambda: EST(0), "bins must be"),
        (lambda: EST(hidden=(5,)), "hidden must be a whole number of at least 6"),
        (
            lambda: EST()(EventBatch.of([Events.empty((4, 3)), Events.empty((5, 3))])),
            r"several sensor sizes, 4x3, 5x3",
        ),
    ):
        with pytest.raises(ValueError, match=reason):
            make()


def test_by_default_it_is_the_authors():
    net = EST()
    assert [tuple(layer.weight.shape) for layer in net.layers] == [(30, 1), (30, 30), (1, 30)]
    assert net(EventBatch.of([Events.empty((4, 3))])).shape == (1, 18, 3, 4)
    assert repr(net).startswith("EST(\n  bins=9\n")
    assert [layer.out_features for layer in EST(hidden=(6, 7)).layers] == [6, 7, 1]
