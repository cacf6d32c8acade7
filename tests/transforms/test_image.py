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
    image = T.EventImage()(ev)
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
    assert torch.equal(image[:, 0], T.EventImage()(windows[0]))
    assert image[:, 1].sum() == 0
    with pytest.raises(ValueError, match="can't stack"):
        T.EventImage()([])


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
    with pytest.raises(ValueError, match="40x30 contains no square of 50"):
        T.CenterCrop(50)(torch.rand(30, 40))


def test_mirrors_and_norms():
    image = torch.rand(2, 3, 4)
    assert torch.equal(T.RandomFlip(0, 1.0)(image), image.flip(-1))
    assert torch.equal(T.RandomFlip(0, 0.0)(image), image)
    normal = T.Normalize()(image)
    assert abs(normal.mean()) < 1e-6
    assert normal.square().mean() == pytest.approx(1.0, abs=1e-5)
    assert torch.equal(T.Normalize()(torch.ones(3, 3)), torch.zeros(3, 3))


@pytest.mark.parametrize("build", [lambda: T.Resize(0), lambda: T.RandomCrop(4, ()), lambda: T.RandomFlip(0, 2)])
def test_settings_are_checked(build):
    with pytest.raises(ValueError, match=r"size|scales|p must"):
        build()


def test_images_of_different_sensors_are_no_sequence():
    one, other = Events([0], [1], [0], [1], (5, 4)), Events([0], [1], [0], [1], (5, 3))
    with pytest.raises(ValueError, match=r"can't stack images of \[\(2, 3, 5\), \(2, 4, 5\)\]"):
        T.EventImage()([one, other])


@pytest.mark.parametrize(
    ("given", "size", "made"),
    [((3, 7), 6, (6, 14)), ((7, 3), 6, (14, 6)), ((5, 5), 1, (1, 1)), ((3, 5), 4, (4, 7)), ((4, 6), 4, (4, 6))],
)
def test_the_smaller_side_gets_the_size_and_the_other_its_share(given, size, made):
    height, width = given
    assert T.Resize(size)(torch.rand(2, 3, height, width)).shape == (2, 3, *made)
    corner = Events([0, 1], [0, width - 1], [0, height - 1], [1, 1], (width, height))
    found = T.Resize(size)(corner)
    assert found.sensor_size == made[::-1]
    assert found.x.tolist() == [0, (width - 1) * made[1] // width]
    assert found.y.tolist() == [0, (height - 1) * made[0] // height]


def test_normalized_numbers_by_hand():
    assert T.Normalize()(torch.tensor([1.0, 3.0, 5.0, 7.0])).tolist() == pytest.approx(
        [v / 5**0.5 for v in (-3, -1, 1, 3)]
    )
    assert T.Normalize()(torch.full((2, 2), 3.0)).tolist() == [[0, 0], [0, 0]]
    tiny = T.Normalize()(torch.tensor([0.0, 2e-12]))
    assert tiny.tolist() == pytest.approx([-1, 1])
