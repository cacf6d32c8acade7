"""Batches of samples of unequal size."""

from functools import partial

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import Events
from nvsdata import transforms as T
from nvsdata.data.ragged import EventBatch, Padded

shapes = st.integers(1, 3).flatmap(
    lambda axes: st.lists(st.tuples(*[st.integers(0, 5)] * axes), min_size=1, max_size=4)
)


@given(shapes)
def test_padding_keeps_all_values_and_says_where_they_are(sizes):
    samples = [torch.rand(size) + 1 for size in sizes]
    padded, targets = nvsdata.collate([(sample, n) for n, sample in enumerate(samples)], pad=True)
    assert targets.tolist() == list(range(len(sizes)))
    assert padded.values.shape == (len(sizes), *np.max(sizes, 0))
    assert padded.sizes.tolist() == [list(size) for size in sizes]
    assert padded.lengths.tolist() == [size[0] for size in sizes]
    assert padded.mask.shape == padded.values.shape
    for sample, values, mask in zip(samples, padded.values, padded.mask, strict=True):
        assert values[mask].equal(sample.flatten())
        assert not values[~mask].any()


def recordings():
    return [
        Events(np.arange(n) * 10 + 10**15, np.arange(n), np.arange(n) % 3, np.arange(n) % 2, (9, 3)) for n in (4, 0, 7)
    ]


def test_events_stand_one_after_the_other():
    samples = recordings()
    batch, _ = nvsdata.collate([(ev, 0) for ev in samples], events="columns")
    assert isinstance(batch, EventBatch)
    assert len(batch) == 3
    assert batch.offsets.tolist() == [0, 4, 4, 11]
    assert batch.batch.tolist() == [0] * 4 + [2] * 7
    assert batch.sensor_sizes == ((9, 3),) * 3
    for name in ("t", "x", "y", "p"):
        column = getattr(batch, name).numpy()
        assert column.dtype == getattr(samples[0], name).dtype
        for ev, start, stop in zip(samples, batch.offsets, batch.offsets[1:], strict=False):
            assert np.array_equal(column[start:stop], getattr(ev, name))
    assert nvsdata.collate([(ev, 0) for ev in samples]).inputs == samples


@pytest.mark.parametrize("workers", [0, 1])
def test_a_loader_of_unequal_frames_and_of_events(workers):
    data = [(T.ToFrames(count=3)(ev), n) for n, ev in enumerate(recordings())]
    collated = partial(nvsdata.collate, pad=True)
    (frames, _), *_ = DataLoader(data, 3, collate_fn=collated, num_workers=workers)
    assert isinstance(frames, Padded)
    assert frames.lengths.tolist() == [2, 1, 3]
    assert frames.values.shape == (3, 3, 2, 3, 9)
    assert frames.to("cpu").values.equal(frames.values)
    data = [(ev, n) for n, ev in enumerate(recordings())]
    (events, _), *_ = DataLoader(data, 3, collate_fn=partial(nvsdata.collate, events="columns"), num_workers=workers)
    assert events.offsets.tolist() == [0, 4, 4, 11]
    assert events.to("cpu").t.equal(events.t)


def test_files_that_do_not_state_their_sensor_are_named_as_a_cause(tmp_path):
    """As N-MNIST's: of one without events in the last column, another size follows."""
    for name, x in (("whole", 33), ("narrow", 32)):
        ev = Events([1, 2], [0, x], [0, 33], [0, 1], (34, 34))
        nvsdata.write(ev, tmp_path / f"{name}.bin")
    read = [nvsdata.read(tmp_path / f"{name}.bin") for name in ("whole", "narrow")]
    assert [ev.sensor_size for ev in read] == [(34, 34), (33, 34)]
    cure = r"have several sensor sizes, 33x34, 34x34: .* pass sensor_size=\(34, 34\) to nvsdata.read, nvsdata.open"
    for sample in (T.EventImage(), T.ToFrames(3), T.VoxelGrid(2)):
        with pytest.raises(ValueError, match=cure):
            nvsdata.collate([(sample(ev), 0) for ev in read])
    with pytest.raises(ValueError, match=cure):
        _ = nvsdata.collate([(ev, 0) for ev in read], events="columns").inputs.sensor_size
    stated = [nvsdata.read(tmp_path / f"{name}.bin", sensor_size=(34, 34)) for name in ("whole", "narrow")]
    assert nvsdata.collate([(T.EventImage()(ev), 0) for ev in stated]).inputs.shape == (2, 2, 34, 34)


def test_samples_that_do_not_fit_are_named():
    frames = [(torch.zeros(3, 2), 0), (torch.zeros(3, 2), 0), (torch.zeros(4, 2), 0)]
    expected = r"sample 0 has the shape \(3, 2\), sample 2 \(4, 2\): .* pad=True.*T.Resize.*batch_size=1"
    with pytest.raises(ValueError, match=expected) as raised:
        nvsdata.collate(frames)
    assert "sensor" not in str(raised.value)
    with pytest.raises(ValueError, match=r"sample 1 \(3,\): they don't fit into one batch"):
        nvsdata.collate([(torch.zeros(3, 2), 0), (torch.zeros(3), 0)], pad=True)
    with pytest.raises(ValueError, match="events must be 'list' or 'columns', not 'offsets'"):
        nvsdata.collate(frames, events="offsets")
    assert nvsdata.collate(frames[:2]).inputs.shape == (2, 3, 2)
    assert nvsdata.collate([(torch.tensor(1.0), 0)] * 2, pad=True).inputs.tolist() == [1, 1]


def test_when_samples_begin_and_how_long_they_last():
    batch = EventBatch.of([make([7, 9, 30]), make([]), make([5]), make([])])
    assert batch.starts.tolist() == [7, 0, 5, 0]
    assert batch.durations.tolist() == [23, 0, 0, 0]
    assert batch.batch.tolist() == [0, 0, 0, 2]
    assert EventBatch.of([make([])]).starts.tolist() == [0]
    assert EventBatch.of([make([])]).durations.tolist() == [0]
    assert len(batch) == 4


def test_sensors_of_one_size_have_it():
    assert EventBatch.of([make([1], (9, 3)), make([2], (9, 3))]).sensor_size == (9, 3)
    several = EventBatch.of([make([1], (9, 3)), make([2], (4, 5)), make([2], (9, 3))])
    assert several.sensor_sizes == ((9, 3), (4, 5), (9, 3))
    with pytest.raises(ValueError, match=r"several sensor sizes, 4x5, 9x3: .* crop or resize them$"):
        _ = several.sensor_size


def make(t, size=(9, 3)):
    return Events(t, [0] * len(t), [0] * len(t), [0] * len(t), size)
