import numpy as np
import torch

from nvsdata import Events
from nvsdata import transforms as T


def cloud(n, start=0):
    rng = np.random.default_rng(n)
    t = start + np.sort(rng.integers(0, 1_000_000, n))
    return Events(t, rng.integers(0, 240, n), rng.integers(0, 180, n), rng.integers(0, 2, n), (240, 180))


def test_points_are_scaled_events_in_order_of_time():
    points = T.Points(500)(cloud(2000))
    assert points.shape == (500, 4)
    assert points.dtype == torch.float32
    assert (points[1:, 2] >= points[:-1, 2]).all()
    assert points[:, :3].min() >= 0
    assert points[:, :3].max() <= 1
    assert set(points[:, 3].tolist()) == {-1.0, 1.0}


def test_all_events_are_there_if_they_are_no_more_than_asked_for():
    ev = cloud(300)
    points = T.Points(300)(ev)
    t = (ev.t - ev.t[0]) / (ev.t[-1] - ev.t[0])
    expected = np.stack((ev.x / 239, ev.y / 179, t, 2.0 * ev.p - 1), 1)
    assert np.allclose(points.numpy(), expected, atol=1e-6)


def test_few_events_are_repeated_and_none_are_zeros():
    assert T.Points(64)(cloud(5)).unique(dim=0).shape[0] <= 5
    assert torch.equal(T.Points(8)(cloud(0)), torch.zeros(8, 4))
    assert T.Points(8)(cloud(1)).isfinite().all()


def test_absolute_times_make_no_difference():
    torch.manual_seed(1)
    here = T.Points(100)(cloud(300))
    torch.manual_seed(1)
    assert torch.equal(here, T.Points(100)(cloud(300, 1_600_000_000_000_000)))
