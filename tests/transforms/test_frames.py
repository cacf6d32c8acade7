"""Frames for convolutional networks against the definitions, pixel by pixel."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events
from nvsdata import transforms as T


@given(events(max_size=80), st.sampled_from([30.0, 1000.0]), st.integers(1, 9))
def test_frames_sum_polarity_and_average_cells(ev, fps, factor):
    ev = Events(ev.t - ev.start, ev.x, ev.y, ev.p, ev.sensor_size, start=0)[(ev.t - ev.start) < 10**5]
    width, height = ev.sensor_size
    count = max(math.ceil(int(ev.t.max(initial=0)) * fps / 10**6), 1)
    dense = np.zeros((count, height, width))
    for t, x, y, p in zip(*(column.tolist() for column in ev.columns), strict=True):
        dense[max(math.ceil(t * fps / 10**6) - 1, 0), y, x] += 2 * p - 1
    frames = T.ToFrames(fps=fps, values="sum", factor=factor)(ev)
    rows, columns = -(-height // factor), -(-width // factor)
    assert frames.shape == (count, rows, columns)
    assert frames.dtype == torch.float32
    expected = np.empty((count, rows, columns))
    for r in range(rows):
        for c in range(columns):
            cell = dense[:, r * factor : (r + 1) * factor, c * factor : (c + 1) * factor]
            expected[:, r, c] = cell.mean((1, 2))
    np.testing.assert_allclose(frames, expected, rtol=1e-6)


def test_the_size_of_the_thesis():
    ev = Events([0, 10**6], [319, 0], [239, 0], [1, 0])
    frames = T.ToFrames(fps=25, values="sum", factor=8)(ev)
    assert frames.shape == (25, 30, 40)
    assert frames.sum() == 0
    assert frames[0, 29, 39] == 1 / 64
    assert T.FourCrops()(T.RandomTemporalCrop()(frames)).shape == (4, 160, 24, 24)


def test_emulated_events_at_the_frame_itself_belong_to_it():
    ev = Events([40_000, 80_000], [0, 1], [0, 0], [1, 1], (2, 1), start=0)
    assert T.ToFrames(fps=25, values="sum")(ev).tolist() == [[[1, 0]], [[0, 1]]]


def test_clips_are_cut_at_random_or_filled_up():
    frames = torch.arange(10.0).reshape(10, 1, 1).expand(10, 2, 3)
    starts = {int(T.RandomTemporalCrop(4)(frames)[0, 0, 0]) for _ in range(200)}
    assert starts == set(range(7))
    long = T.RandomTemporalCrop(12)(frames)
    assert long[:, 0, 0].tolist() == [*range(10), 0, 0]


def test_sliding_clips_are_frames_in_a_row():
    frames = torch.randn(5, 4, 6)
    found = T.SlidingClips(3)(frames)
    assert found.shape == (3, 3, 4, 6)
    for n in range(3):
        assert (found[n] == frames[n : n + 3]).all()
    with pytest.raises(ValueError, match="2 frames make no clip of 3"):
        T.SlidingClips()(frames[:2])


@given(st.integers(1, 9), st.integers(1, 9), st.integers(1, 9), st.integers(0, 99))
def test_the_crop_with_the_most_activity(height, width, size, seed):
    frames = torch.from_numpy(np.random.default_rng(seed).integers(-2, 3, (3, height, width)).astype(np.float32))
    if size > min(height, width):
        with pytest.raises(ValueError, match="contain no square"):
            T.MotionCrop(size)(frames)
        return
    places = [(y, x) for y in range(height - size + 1) for x in range(width - size + 1)]
    y, x = max(places, key=lambda at: float(frames[:, at[0] : at[0] + size, at[1] : at[1] + size].abs().sum()))
    crop = T.MotionCrop(size)(frames)
    assert (crop == frames[:, y : y + size, x : x + size]).all()
    four = T.FourCrops(size)(frames)
    assert (four[0] == crop).all()
    assert (four[1] == crop.flip(-1)).all()
    top, left = (height - size) // 2, (width - size) // 2
    assert (four[2] == frames[:, top : top + size, left : left + size]).all()


@given(st.integers(1, 7), st.integers(1, 7), st.integers(0, 99))
def test_denoising_takes_the_median_of_four(height, width, seed):
    frames = np.random.default_rng(seed).integers(-3, 4, (2, height, width)).astype(np.float32)
    padded = np.pad(frames, ((0, 0), (0, 1), (0, 1)), mode="edge")
    found = T.MedianDenoise()(torch.from_numpy(frames))
    for y in range(height):
        for x in range(width):
            four = padded[:, y : y + 2, x : x + 2].reshape(2, 4)
            np.testing.assert_array_equal(found[:, y, x], np.median(four, 1))


def test_a_spike_on_its_own_is_noise():
    frame = torch.zeros(1, 5, 5)
    frame[0, 2, 2] = 3
    assert (T.MedianDenoise()(frame) == 0).all()


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: T.ToFrames(fps=0, values="sum"), "fps must be positive"),
        (lambda: T.ToFrames(1, values="sum", factor=0), "factor must be a whole number"),
        (lambda: T.ToFrames(1, factor=2), "factor averages sums"),
        (lambda: T.ToFrames(1, values="sum", dtype="int16", factor=2), "factor averages sums"),
        (lambda: T.RandomTemporalCrop(0), "length must be a whole number"),
        (lambda: T.SlidingClips(0), "length must be a whole number"),
        (lambda: T.MotionCrop(0), "size must be a whole number"),
    ],
)
def test_settings_out_of_range(build, says):
    with pytest.raises(ValueError, match=says):
        build()
