import torch

from nvsdata.models import BatchNorm


def test_it_normalizes_as_torch_does():
    ours, theirs = BatchNorm(4), torch.nn.BatchNorm1d(4)
    x = torch.randn(50, 4) * 3 + 1
    assert torch.allclose(ours(x), theirs(x))


def test_running_statistics_are_the_mean_of_the_first_batches():
    norm = BatchNorm(1)
    batches = [torch.randn(100, 1) * 0.01 + i for i in range(5)]
    for x in batches:
        norm(x)
    assert torch.allclose(norm.running_mean, torch.tensor([2.0]), atol=0.01)
    assert torch.allclose(norm.running_var, torch.stack([x.var() for x in batches]).mean()[None], rtol=1e-4)


def test_later_batches_follow_the_momentum():
    norm = BatchNorm(1)
    for _ in range(20):
        norm(torch.tensor([[-1.0], [1.0]]))
    norm(torch.tensor([[9.0], [11.0]]))
    assert torch.allclose(norm.running_mean, torch.tensor([1.0]), atol=1e-5)


def test_a_single_node_uses_the_running_statistics_and_leaves_them_alone():
    norm = BatchNorm(2)
    norm(torch.randn(30, 2) + 5)
    before = [b.clone() for b in norm.buffers()]
    out = norm(torch.tensor([[5.0, 5.0]]))
    norm(torch.empty(0, 2))
    assert out.abs().max() < 1
    assert all(torch.equal(a, b) for a, b in zip(before, norm.buffers(), strict=True))
