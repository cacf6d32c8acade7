"""Accuracies and votes against a table that was filled in by hand."""

import pytest
import torch
from torch import nn

from nvsdata import models
from nvsdata.models.distributed import Dropout
from nvsdata.models.prediction import vote
from nvsdata.training import Team, votes
from nvsdata.training.evaluation import correct, predict

HERE = Team(torch.device("cpu"))
TARGETS = [0, 1, 2, 1]
# rounds of three windows of four recordings: probabilities of three classes
TABLE = [
    [
        [(0.6, 0.3, 0.1), (0.5, 0.4, 0.1), (0.3, 0.3, 0.4), (0.7, 0.2, 0.1)],  # right: first and third
        [(0.5, 0.4, 0.1), (0.1, 0.8, 0.1), (0.2, 0.2, 0.6), (0.1, 0.5, 0.4)],  # all
        [(0.1, 0.8, 0.1), (0.2, 0.7, 0.1), (0.4, 0.3, 0.3), (0.2, 0.5, 0.3)],  # second and fourth
    ],
    [
        [(0.9, 0.05, 0.05), (0.1, 0.8, 0.1), (0.3, 0.3, 0.4), (0.2, 0.6, 0.2)],  # all
        [(0.8, 0.15, 0.05), (0.1, 0.8, 0.1), (0.9, 0.05, 0.05), (0.4, 0.3, 0.3)],  # first and second
        [(0.001, 0.5, 0.499), (0.1, 0.8, 0.1), (0.4, 0.3, 0.3), (0.3, 0.4, 0.3)],  # second and fourth
    ],
]
SINGLE = (2 + 4 + 2 + 4 + 2 + 2) / 24
# by the products of a recording's three: such as .03, .096, .001 of the first. The first window alone would have 6 of 8
# right, the last one 4, the mean of probabilities 6, the name that most windows give 7
NAMED = [[1, 1, 2, 1], [1, 1, 0, 1]]
TOGETHER = (3 + 2) / 8


def batches(size):
    """Every recording once, then again, and so on, in batches; scores are logarithms up to a constant."""
    scores = torch.tensor(TABLE, dtype=torch.float64).log().view(-1, 3) + 7
    targets = torch.tensor(TARGETS * 6)
    return list(zip(scores.split(size), targets.split(size), strict=True))


def scores(given):
    return given


def of_votes(found):
    return found.single.value, found.together.value


@pytest.mark.parametrize("size", [1, 3, 4, 24])
def test_accuracies_are_those_of_the_table(size):
    assert of_votes(votes(scores, batches(size), 3, HERE, 2)) == pytest.approx((SINGLE, TOGETHER))
    # as one round of six, three of two, six of one: single windows stay what they are
    names = torch.tensor(TABLE).view(6, 4, 3)
    for rounds in (1, 3, 6):
        wanted = names.view(rounds, 6 // rounds, 4, 3).prod(1).argmax(-1) == torch.tensor(TARGETS)
        together = wanted.double().mean().item()
        found = votes(scores, batches(size), 6 // rounds, HERE, rounds)
        assert of_votes(found) == pytest.approx((SINGLE, together))


def test_votes_keep_what_every_window_says():
    found = votes(scores, batches(5), 3, HERE, 2)
    torch.testing.assert_close(found.voters.exp(), torch.tensor(TABLE, dtype=torch.float64))
    assert found.targets.tolist() == TARGETS
    assert vote(found.voters, 1).argmax(-1).tolist() == NAMED
    assert (found.single.value, found.together.value) == pytest.approx((SINGLE, TOGETHER))


def test_a_share_is_of_scores_that_are_highest_for_their_own_target():
    given = torch.tensor([[0.0, 2.0], [3.0, 1.0], [0.0, 1.0], [torch.nan, 1.0]])
    assert correct(given, torch.tensor([1, 0, 0, 1])).tolist() == [True, True, False, False]
    assert correct(given, torch.tensor([0, 1, 1, 0])).tolist() == [False, False, True, False]
    # of many windows, against the same targets
    assert correct(given[:3].expand(5, 2, 3, 2), torch.tensor([1, 0, 0])).tolist() == [[[True, True, False]] * 2] * 5


def test_a_network_is_asked_as_it_is_in_use():
    """Without dropout, by running statistics, and without a trace for gradients."""
    torch.manual_seed(0)
    model = nn.Sequential(nn.Linear(3, 8), models.BatchNorm(8), Dropout(0.5), nn.Linear(8, 2))
    model.train()(torch.randn(50, 3))
    x, before = torch.randn(20, 3), model[1].running_mean.clone()
    given, targets = predict(model.train(), [(x[:13], torch.arange(13)), (x[13:], torch.arange(13, 20))], HERE)
    assert targets.tolist() == list(range(20))
    assert not given.requires_grad
    assert torch.equal(model[1].running_mean, before)
    torch.testing.assert_close(given, model.eval()(x).detach())
