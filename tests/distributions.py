"""Every dataset with a maker of its files as distributed, and how many recordings it has for training and testing."""

from __future__ import annotations

import trees

from nvsdata.datasets import (
    ASLDVS,
    CIFAR10DVS,
    HMDB51DVS,
    MNISTDVS,
    NCARS,
    NMNIST,
    UCF50DVS,
    UCF101DVS,
    YUPENNDVS,
    DVS128Gesture,
    NCaltech101,
)

CASES = {
    "n-mnist": (trees.nmnist, NMNIST, 30, 20),
    "n-caltech101": (trees.ncaltech101, NCaltech101, 32, 8),
    "mnist-dvs": (trees.mnistdvs, MNISTDVS, 20, 10),
    "cifar10-dvs": (trees.cifar10dvs, CIFAR10DVS, 24, 6),
    "n-cars": (trees.ncars, NCARS, 8, 8),
    "asl-dvs": (trees.asldvs, ASLDVS, 24, 6),
    "dvs128-gesture": (trees.dvs128gesture, DVS128Gesture, 24, 24),
    "dvs128-gesture, preprocessed": (trees.dvs128gesture_preprocessed, DVS128Gesture, 22, 11),
    "ucf50-dvs": (trees.ucf50dvs, UCF50DVS, 4, 2),
    "ucf101-dvs": (trees.ucf101dvs, UCF101DVS, 4, 4),
    "hmdb51-dvs": (trees.hmdb51dvs, HMDB51DVS, 6, 4),
    "yupenn-dvs": (trees.yupenndvs, YUPENNDVS, 8, 1),
}


def check_same(one, other):
    """Both hand back the same samples in the same order."""
    assert len(one) == len(other) > 0
    assert one.targets == other.targets
    for i in range(len(one)):
        assert one.samples[i].stem == other.samples[i].stem
        assert one[i][0] == other[i][0]
