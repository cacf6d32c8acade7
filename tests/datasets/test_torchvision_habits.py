"""What users of torchvision expect of a dataset: `train=`, `transforms=`, halves of their own, weights of classes."""

import random

import numpy as np
import pytest
import torch
import trees
from torch.utils.data import DataLoader, WeightedRandomSampler

import nvsdata
from nvsdata import ASLANDVS, MNISTDVS, NMNIST, EventFolder, NCaltech101
from nvsdata import transforms as T


@pytest.fixture
def digits(home):
    return home(trees.nmnist())


@pytest.mark.parametrize(
    ("how", "named", "name"),
    [
        ((), {}, "train"),
        ((), {"train": True}, "train"),
        ((), {"train": False}, "test"),
        (("test",), {"train": False}, "test"),
        (("all",), {}, "all"),
    ],
)
def test_a_split_by_name_or_by_train(digits, how, named, name):
    dataset = NMNIST(digits, *how, **named)
    assert dataset.split_name == name
    assert dataset.split_hash == NMNIST(digits, name).split_hash


@pytest.mark.parametrize(
    ("how", "named"),
    [
        (("train",), {"train": False}),
        (("test",), {"train": True}),
        (("all",), {"train": True}),
    ],
)
def test_splits_that_contradict_each_other(digits, how, named):
    with pytest.raises(ValueError, match="contradict each other: give one of them"):
        NMNIST(digits, *how, **named)


def test_a_split_is_a_string(digits):
    with pytest.raises(ValueError, match="split must be 'train', 'test', 'all', not True"):
        NMNIST(digits, True)


def test_train_is_true_or_false(digits):
    with pytest.raises(ValueError, match="train must be True, False or None, not 'test'"):
        NMNIST(digits, train="test")


def test_train_of_a_folder_whose_usual_split_is_all(tmp_path):
    trees.put(tmp_path, {f"{part}/ant/{i}.h5": b"" for part in ("train", "test") for i in range(2)})
    for part in ("train", "test"):
        for i in range(2):
            nvsdata.write(trees.some(i), tmp_path / f"{part}/ant/{i}.h5")
    assert len(EventFolder(tmp_path)) == 4
    assert EventFolder(tmp_path, train=True).recording_names() == EventFolder(tmp_path, "train").recording_names()
    assert len(EventFolder(tmp_path, train=False)) == 2
    with pytest.raises(ValueError, match="split='all' and train=True contradict"):
        EventFolder(tmp_path, "all", train=True)


def test_transforms_in_the_order_that_torchvision_has(digits):
    dataset = NMNIST(digits, "test", T.EventImage(), str)
    sample, target = dataset[0]
    assert sample.shape == (2, 34, 34)
    assert target == "0"


@pytest.mark.parametrize("kind", [NMNIST, MNISTDVS, NCaltech101, EventFolder])
def test_transforms_of_sample_and_target_together(home, kind):
    trees_of = {
        NMNIST: trees.nmnist,
        MNISTDVS: trees.mnistdvs,
        NCaltech101: trees.ncaltech101,
        EventFolder: trees.nmnist,
    }
    root = home(trees_of[kind]())
    dataset = kind(root, "all", transforms=lambda recording, target: (len(recording.read()), -target))
    assert dataset[-1] == (len(dataset.recording(len(dataset) - 1).read()), -dataset.targets[-1])
    with pytest.raises(ValueError, match="takes the place of transform and target_transform"):
        kind(root, "all", transforms=lambda a, b: (a, b), transform=T.EventImage())
    with pytest.raises(TypeError, match="transforms must be callable, not 3"):
        kind(root, "all", transforms=3)
    with pytest.raises(TypeError, match="target_transform must be callable, not 3"):
        kind(root, "all", target_transform=3)


def test_transforms_of_a_pair_get_both_recordings(home):
    dataset = ASLANDVS(home(trees.aslandvs(True)), "all", transforms=lambda pair, target: (len(pair), target))
    assert dataset[0][0] == 2


def test_indices_from_the_end_and_beyond(digits):
    dataset = NMNIST(digits)
    assert dataset[-1][0] == dataset[len(dataset) - 1][0]
    for index in (len(dataset), -len(dataset) - 1):
        with pytest.raises(IndexError):
            dataset[index]
    assert len(list(dataset)) == len(dataset)


def test_the_repr_tells_the_sample_and_uses_up_no_random_numbers(digits):
    dataset = NMNIST(digits, transform=T.Compose([T.RandomWindow(10_000), T.EventImage()]))
    before = torch.get_rng_state()
    assert "sensor: 34x34\n    sample: float32 [2, 34, 34]\n" in repr(dataset)
    assert torch.equal(torch.get_rng_state(), before)
    dataset.transform = lambda recording: (np.random.rand(), random.random())  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    random.seed(0)
    repr(dataset)
    drawn = np.random.rand(), random.random()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    random.seed(0)
    assert drawn == (np.random.rand(), random.random())  # noqa: NPY002
    dataset.transform = lambda recording: 1 / 0
    assert "sample: can't be made (ZeroDivisionError: division by zero)" in repr(dataset)
    dataset.transform = lambda recording: {"a": np.zeros(3), "b": [torch.ones(2)] * 4, "c": ()}
    assert "sample: a: float64 [3], b: 4 x float32 [2], c: ()" in repr(dataset)


def test_halves_share_no_recording_and_no_augmentation(digits):
    dataset = NMNIST(digits, transform=T.EventImage())
    first, second = dataset.split(2 / 3, seed=1)
    assert sorted(first.recording_names() + second.recording_names()) == sorted(dataset.recording_names())
    assert (first.class_counts, second.class_counts) == ([2] * 10, [1] * 10)
    second.transform = None
    assert isinstance(first[0][0], torch.Tensor)
    assert isinstance(second[0][0], nvsdata.Events)
    again, other = dataset.split(2 / 3, seed=1)[0], dataset.split(2 / 3, seed=2)[0]
    assert again.split_hash == first.split_hash != other.split_hash
    for share in (0, 1, 1.5):
        with pytest.raises(ValueError, match=f"fraction must be between 0 and 1, not {share}"):
            dataset.split(share)


def test_windows_of_a_recording_stay_together(digits):
    dataset = nvsdata.windows(NMNIST(digits), 10_000)
    sides = [{sample.name for sample in side.samples} for side in dataset.split(0.5)]
    assert len(dataset) > 2 * len(set.union(*sides))
    assert sides[0].isdisjoint(sides[1])


def test_classes_drawn_equally_often(digits):
    dataset = NMNIST(digits).subset([*range(6), *[7] * 6])
    assert dataset.class_counts == [3, 3, 6, 0, 0, 0, 0, 0, 0, 0]
    weights = dataset.class_weights
    assert torch.allclose(weights[:4], torch.tensor([4 / 3, 4 / 3, 2 / 3, 0]))
    assert weights[dataset.targets].mean() == pytest.approx(1)
    sampler = WeightedRandomSampler(weights[dataset.targets], 6_000)
    drawn = np.bincount([dataset.targets[i] for i in sampler], minlength=10)
    assert np.allclose(drawn[:3], 2_000, atol=200)
    loader = DataLoader(dataset, 4, sampler=WeightedRandomSampler(weights[dataset.targets], 8))
    assert len(list(loader)) == 2


@pytest.mark.parametrize("name", nvsdata._ELSEWHERE)
def test_names_of_torchvision_are_answered_with_ours(name):
    for line in (f"from nvsdata import {name}", f"import nvsdata; nvsdata.{name}"):
        with pytest.raises(ImportError, match=f"no attribute '{name}'; it is {nvsdata._ELSEWHERE[name]} here"):
            exec(line)
    assert hasattr(nvsdata, nvsdata._ELSEWHERE[name])
    assert not hasattr(nvsdata, "Anything")
