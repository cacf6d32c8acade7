import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events
from nvsdata import transforms as T


@given(events(max_size=60))
def test_an_event_image_counts_events(ev):
    image = T.event_image(ev)
    width, height = ev.sensor_size
    expected = np.zeros((2, height, width))
    for x, y, p in zip(ev.x, ev.y, ev.p, strict=True):
        expected[1 - p, y, x] += 1
    assert image.dtype == torch.float32
    assert np.array_equal(image.numpy(), expected)


def test_windows_become_a_sequence_of_images():
    windows = [Events([0, 1], [1, 2], [0, 1], [1, 0], (5, 4)), Events([], [], [], [], (5, 4))]
    image = T.EventImage()(windows)
    assert image.shape == (2, 2, 4, 5)
    assert torch.equal(image[:, 0], T.event_image(windows[0]))
    assert image[:, 1].sum() == 0
    with pytest.raises(ValueError, match="can't stack"):
        T.event_image([])


def test_resize_keeps_the_aspect_and_constant_images():
    image = T.Resize(256)(torch.full((2, 3, 180, 240), 7.0))
    assert image.shape == (2, 3, 256, 341)
    assert torch.allclose(image, torch.tensor(7.0))


@given(st.integers(5, 12), st.integers(5, 12))
def test_crops_are_parts_of_the_image(height, width):
    image = torch.arange(float(2 * height * width)).view(2, height, width)
    cut = T.RandomCrop(4)(image)
    parts = image.unfold(1, 4, 1).unfold(2, 4, 1)
    assert cut.shape == (2, 4, 4)
    assert any(torch.equal(cut, parts[:, y, x]) for y in range(height - 3) for x in range(width - 3))
    center = T.CenterCrop(4)(image)
    assert torch.equal(center, parts[:, (height - 4) // 2, (width - 4) // 2])


def test_multi_scale_crops_come_out_at_one_size():
    torch.manual_seed(0)
    crop = T.RandomCrop(24, (0.5, 0.667, 0.833, 1.0))
    assert {crop(torch.rand(160, 30, 40)).shape for _ in range(10)} == {(160, 24, 24)}
    with pytest.raises(ValueError, match="40x30 holds no square of 50"):
        T.CenterCrop(50)(torch.rand(30, 40))


def test_mirrors_and_norms():
    image = torch.rand(2, 3, 4)
    assert torch.equal(T.RandomHorizontalFlip(1.0)(image), image.flip(-1))
    assert torch.equal(T.RandomHorizontalFlip(0.0)(image), image)
    normal = T.Normalize()(image)
    assert abs(normal.mean()) < 1e-6
    assert normal.square().mean() == pytest.approx(1.0, abs=1e-5)
    assert torch.equal(T.Normalize()(torch.ones(3, 3)), torch.zeros(3, 3))


@pytest.mark.parametrize("build", [lambda: T.Resize(0), lambda: T.RandomCrop(4, ()), lambda: T.RandomHorizontalFlip(2)])
def test_settings_are_checked(build):
    with pytest.raises(ValueError, match=r"size|scales|p must"):
        build()
