import torch

from nvsdata.models.prediction import vote


def test_a_vote_is_the_geometric_mean_of_probabilities():
    scores = torch.randn(2, 5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    given = torch.exp(scores) / torch.exp(scores).sum(-1, keepdim=True)
    mean = torch.stack([given[:, i] for i in range(5)]).prod(0) ** (1 / 5)
    torch.testing.assert_close(vote(scores, 1), mean / mean.sum(-1, keepdim=True))


def test_a_sure_window_outvotes_unsure_ones():
    scores = torch.tensor([[0.0, 0.1], [0.0, 0.1], [9.0, 0.0]])
    assert vote(scores).argmax() == 0


def test_scores_that_are_nan_stay_nan():
    assert vote(torch.tensor([[0.0, float("nan")], [0.0, 1.0]])).isnan().all()
