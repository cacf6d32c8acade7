"""What is done to samples: the augmentation of the text in training, nothing at random in a test."""

import runpy
from argparse import Namespace

import numpy as np
import pytest
import torch
from lookalikes import saccade
from pipelines import CHOICES, changes, leaves
from places import RECIPES

from nvsdata import Events, GraphBatch
from nvsdata import transforms as T
from nvsdata.training import actions, objects
from nvsdata.training import demo as demo_training
from nvsdata.training.actions import Actions
from nvsdata.training.objects import Objects

MOVED = [T.RandomScale(), T.RandomFlip(0), T.RandomFlip(1), T.RandomRotate()]
DIGITS = [T.RandomAffine((0.85, 1.1), degrees=15, shift=2, shear=0.1, stretch=0.1), T.DropEvents(0.4)]
OTHERS = [T.RandomAffine(), T.RandomFlip(0), T.RandomFlip(1), T.DropEvents(0.4)]
CROPS = [T.RandomTranslate(6), T.RandomFlip(0), T.DropEvents(0.6), T.DropByTime(0.25), T.DropByArea(0.2)]
# settings, and what training adds to what a test does: the thesis's of 4.4.2 and 5.3.1, or ours of departures.md
PROTOCOLS = [
    (Objects("n-mnist"), DIGITS),
    (Objects("mnist-dvs", features=()), DIGITS),
    (Objects("n-cars"), CROPS),
    (Objects("n-cars", nodes="pixels", downsample=2, features=()), CROPS),
    (Objects("cifar10-dvs"), OTHERS),
    (Objects("n-caltech101", features=()), MOVED),
    (Objects("asl-dvs", "gcnn", convolution="gcn", features=("age", "mean3")), OTHERS),
    (Objects("cifar10-dvs", augment=False), []),
    *((Objects("n-mnist", network), None) for network in objects.IMAGE_NETWORKS),
    (Actions(), [T.RandomScale(0.8, 1.0), T.RandomFlip(0)]),
    (Actions(graphs=16, duration=250_000, flip=False), [T.RandomScale(0.8, 1.0)]),
    *((Actions(network), []) for network in actions.POINT_NETWORKS),
    *((Actions(network), None) for network in actions.FRAME_NETWORKS),
    (Actions("c3d", flip=False), None),
]


NAMES = [f"{type(protocol).__name__} {protocol.network} {n}" for n, (protocol, _) in enumerate(PROTOCOLS)]


@pytest.mark.parametrize(("protocol", "added"), PROTOCOLS, ids=NAMES)
def test_only_training_changes_samples_at_random(protocol, added):
    training, test = (protocol.pipeline(training=training) for training in (True, False))
    assert changes(test) == []
    assert any(isinstance(leaf, CHOICES) for leaf in leaves(test))
    if added is not None:
        assert changes(training) == added
        assert [leaf for leaf in leaves(training) if leaf not in added] == leaves(test)
        return
    # images: a random square in place of the middle, and a mirror
    crop = next(leaf for leaf in leaves(test) if isinstance(leaf, T.CenterCrop))
    mirror = [T.RandomFlip()] if getattr(protocol, "flip", True) else []
    assert changes(training) == [T.RandomCrop(crop.size), *mirror]
    kept = [T.CenterCrop(leaf.size) if isinstance(leaf, T.RandomCrop) else leaf for leaf in leaves(training)]
    assert [leaf for leaf in kept if leaf not in mirror] == leaves(test)


def test_other_pipelines_to_test_on(monkeypatch):
    monkeypatch.syspath_prepend(RECIPES)
    args = Namespace(fps=30.0, frames=16, image_size=224, no_flip=False)
    transfer, letters = (runpy.run_path(str(RECIPES / f"{name}.py")) for name in ("transfer_emulated", "sign_language"))
    tests = transfer["test_pipeline"](args), letters["test_transform"](args), demo_training.pipeline(augmented=False)
    assert [changes(pipeline) for pipeline in tests] == [[], [], []]
    trainings = transfer["train_pipeline"](args), T.Compose(letters["augmented"](args))
    assert all(changes(pipeline) for pipeline in (*trainings, demo_training.pipeline(augmented=True)))


@pytest.mark.parametrize("protocol", [protocol for protocol, _ in PROTOCOLS], ids=NAMES)
def test_with_window_and_events_given_nothing_is_left_to_draw_in_a_test(protocol, monkeypatch):
    # no recording is longer than its window, and every event is chosen
    monkeypatch.setattr(T.NonUniformSample, "__call__", lambda self, events: events)
    monkeypatch.setattr(T.Points, "__call__", lambda self, events: events)
    t, *others = saccade(np.random.default_rng(0), 3, 120)
    events = Events(t // 5, *others, (34, 34))
    pipeline, found = protocol.pipeline(training=False), []
    for seed in range(4):
        torch.manual_seed(seed)
        found.append(flat(pipeline(events)))
    assert all(torch.equal(found[0], other) for other in found)


def flat(sample):
    if isinstance(sample, torch.Tensor):
        return sample.flatten()
    if isinstance(sample, Events):
        return torch.from_numpy(np.concatenate((sample.t, sample.x, sample.y, sample.p)))
    batch = GraphBatch.from_graphs(sample) if isinstance(sample, list) else sample
    return torch.cat([values.flatten().double() for values in (batch.x, batch.pos, batch.edge_index, batch.edge_attr)])
