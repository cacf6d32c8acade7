"""Several processes compute what one does of the whole batch; here they are threads that meet at each sum."""

import threading
from types import SimpleNamespace

import pytest
import torch

from nvsdata.models import BatchNorm, distributed
from nvsdata.models.distributed import Dropout, all_reduce_sum, process_count


@pytest.fixture
def together(monkeypatch):
    """Runs a function of the rank in as many threads as are asked for, and gives their results."""
    here, meeting = threading.local(), {}

    def all_reduce(x):
        meeting["given"][here.rank] = x.detach().clone()
        meeting["barrier"].wait()
        total = sum(meeting["given"])
        meeting["barrier"].wait()
        x.copy_(total)

    fake = SimpleNamespace(
        is_available=lambda: True,
        is_initialized=lambda: hasattr(here, "rank"),
        get_world_size=lambda: len(meeting["given"]),
        get_rank=lambda: here.rank,
        all_reduce=all_reduce,
    )
    monkeypatch.setattr(distributed, "distributed", fake)

    def run(function, count=2):
        meeting.update(given=[None] * count, barrier=threading.Barrier(count, timeout=20))
        found = [None] * count

        def member(rank):
            here.rank = rank
            found[rank] = function(rank)

        threads = [threading.Thread(target=member, args=(rank,)) for rank in range(count)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return found

    return run


def test_a_sum_and_its_gradient_are_of_all(together):
    def member(rank):
        x = torch.tensor([1.0, 2.0 + rank], requires_grad=True)
        total = all_reduce_sum(x)
        (total * (rank + 1)).sum().backward()
        return process_count(), total.tolist(), x.grad.tolist()

    assert together(member, 3) == [(3, [3.0, 9.0], [6.0, 6.0])] * 3
    assert process_count() == 1
    x = torch.ones(2)
    assert all_reduce_sum(x) is x


@pytest.mark.parametrize("shape", [(4,), (4, 3), (4, 2, 3)])
@pytest.mark.parametrize("sizes", [(3, 5), (1, 1), (6, 0), (2, 1, 4)])
def test_batch_normalization_is_that_of_the_whole_batch(together, shape, sizes):
    torch.manual_seed(0)
    whole = [torch.randn(sum(sizes), *shape, dtype=torch.float64) * 3 + 1 for _ in range(3)]
    upstream = [torch.randn(sum(sizes), *shape, dtype=torch.float64) for _ in range(3)]
    scale = torch.rand(2, 4, dtype=torch.float64) + 0.5

    def train(share):
        norm = BatchNorm(4).double()
        with torch.no_grad():
            norm.weight[:], norm.bias[:] = scale
        given = [x[share].clone().requires_grad_() for x in whole]
        out = [norm(x) for x in given]
        for y, up in zip(out, upstream, strict=True):
            # a copy: torch may keep what it is given as a gradient, and add to it
            y.backward(up[share].clone())
        return [y.detach() for y in out], [x.grad for x in given], list(norm.buffers()), norm.weight.grad

    ends = torch.tensor([0, *sizes]).cumsum(0).tolist()
    members = together(lambda rank: train(slice(ends[rank], ends[rank + 1])), len(sizes))
    out, gradients, buffers, weight = train(slice(None))
    for n in range(3):
        torch.testing.assert_close(torch.cat([member[0][n] for member in members]), out[n])
        torch.testing.assert_close(torch.cat([member[1][n] for member in members]), gradients[n])
    torch.testing.assert_close(sum(member[3] for member in members), weight)
    for member in members:
        for found, expected in zip(member[2], buffers, strict=True):
            torch.testing.assert_close(found, expected)


def test_a_single_value_of_all_processes_has_no_variance(together):
    def member(rank):
        norm = BatchNorm(2)
        x = torch.full((1 - rank, 2), 5.0)
        return norm(x).tolist(), int(norm.num_batches_tracked)

    (first, tracked), (second, _) = together(member)
    assert torch.tensor(first) == pytest.approx(torch.full((1, 2), 5.0), rel=1e-4)
    assert (second, tracked) == ([], 0)


@pytest.mark.parametrize("sizes", [(3, 5), (0, 4), (2, 1, 4)])
def test_dropout_cuts_its_share_of_one_mask(monkeypatch, sizes):
    layer, x = Dropout(0.4), torch.ones(sum(sizes), 6)
    torch.manual_seed(1)
    whole = layer(x)
    assert (whole == 0).any()
    assert (whole > 0).any()
    parts = []
    for rank, size in enumerate(sizes):
        fake = SimpleNamespace(get_rank=lambda rank=rank: rank)
        monkeypatch.setattr(distributed, "distributed", fake)
        monkeypatch.setattr(distributed, "process_count", lambda: len(sizes))

        def counts(own, rank=rank, size=size):
            assert own.tolist() == [size * (n == rank) for n in range(len(sizes))]
            return torch.tensor(sizes, dtype=own.dtype)

        monkeypatch.setattr(distributed, "all_reduce_sum", counts)
        torch.manual_seed(1)
        parts.append(layer(x[:size]))
    assert torch.equal(torch.cat(parts), whole)
