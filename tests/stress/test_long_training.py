"""Sums over an epoch: more samples than float32 can count, and losses that are far apart."""

import math
from fractions import Fraction

import pytest
import torch
from torch import nn
from torch.nn.functional import cross_entropy

from nvsdata.training.processes import Team
from nvsdata.training.trainer import Trainer


class Scaled(nn.Module):
    """Gives its input, times a weight of 1."""

    def __init__(self):
        super().__init__()
        self.weight = nn.Parameter(torch.ones(()))

    def forward(self, x):
        return x * self.weight


def epoch(folder, batches):
    """What a trainer that learns nothing says of an epoch."""
    model = Scaled()
    optimizer = torch.optim.SGD(model.parameters(), lr=0.0)
    schedule = torch.optim.lr_scheduler.ConstantLR(optimizer)
    settings = {"data": {}, "epochs": 1, "batch": 1, "team": Team(torch.device("cpu"))}
    trainer = Trainer(model, optimizer, schedule, folder, **settings)
    return trainer._epoch(model, iter(batches), len(batches), None)


def test_small_losses_after_a_large_one_count(tmp_path):
    """In float32 300 losses of 0.69 after one of 3e7 would be lost: half a unit in its last place is 1."""
    large = torch.tensor([[0.0, 3e7]]), torch.tensor([0])
    small = torch.zeros(1, 2), torch.tensor([0])
    line = epoch(tmp_path, [large] + [small] * 300)
    exact = 3e7 + 300 * float(cross_entropy(*small))
    assert line["loss"] * 301 == pytest.approx(exact, rel=1e-12)
    assert line["train_accuracy"] == 300 / 301


@pytest.mark.long
def test_samples_beyond_float32s_whole_numbers_are_counted(tmp_path):
    size, steps = 2**20 + 1, 18
    scores, targets = torch.zeros(size, 2), torch.zeros(size, dtype=torch.int64)
    other = targets.clone()
    other[7] = 1
    line = epoch(tmp_path, [(scores, targets)] * (steps - 1) + [(scores, other)])
    assert size * steps > 2**24
    assert Fraction(line["train_accuracy"]) == Fraction(float(Fraction(size * steps - 1, size * steps)))
    assert line["loss"] == pytest.approx(math.log(2), rel=1e-6)
