import pytest
import torch

from nvsdata.kernels.graph import pool as cpu

pytest.importorskip("triton.language")

from nvsdata.kernels.triton import pool as kernel
from nvsdata.models.clusters import pooled_rows


def clusters(nodes, count, seed=0):
    """Clusters of nodes, each with a node at least."""
    random = torch.Generator().manual_seed(seed)
    given = torch.cat((torch.arange(count), torch.randint(0, count, (nodes - count,), generator=random)))
    return given[torch.randperm(nodes, generator=random)]


def bits(x):
    return x.cpu().contiguous().view(torch.int32 if x.dtype == torch.float32 else torch.int64)


SIZES = [(1, 1, 1), (60, 1, 5), (60, 60, 3), (90, 17, 130)]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_maxima_are_those_of_the_cpu(size, dtype, device):
    nodes, count, channels = size
    cluster = clusters(nodes, count)
    # many equal values, some NaN and infinite
    x = torch.randint(-2, 3, (nodes, channels)).to(dtype)
    x[torch.rand(x.shape) < 0.03] = torch.nan
    x[torch.rand(x.shape) < 0.03] = -torch.inf
    best, where = kernel.max_rows(x.to(device), *kernel.segments(cluster.to(device), count))
    expected, node = cpu.max_rows(x.numpy(), cluster.numpy(), count)
    torch.testing.assert_close(best.cpu(), torch.from_numpy(expected), rtol=0, atol=0, equal_nan=True)
    assert where.tolist() == node.tolist()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_means_are_bit_identical_to_those_of_the_cpu(size, dtype, device):
    nodes, count, channels = size
    cluster = clusters(nodes, count)
    x = torch.randn(nodes, channels, dtype=dtype) * 10.0 ** torch.randint(-9, 10, (nodes, channels))
    mean = kernel.mean_rows(x.to(device), *kernel.segments(cluster.to(device), count))
    expected, _ = cpu.mean_rows(x.numpy(), cluster.numpy(), count)
    assert torch.equal(bits(mean), bits(torch.from_numpy(expected)))


def test_a_sum_may_overflow_single_precision(device):
    x = torch.full((4, 1), 3e38, device=device)
    assert kernel.mean_rows(x, *kernel.segments(torch.zeros(4, dtype=torch.int64, device=device), 1)).item() == x[0]


@pytest.mark.parametrize("mode", ["max", "average"])
def test_gradients_are_those_of_the_cpu(mode, device, on_triton):
    cluster, x, weight = clusters(70, 9), torch.randint(-2, 3, (70, 5)).float(), torch.randn(9, 5)
    given = x.clone().requires_grad_()
    (pooled_rows(given, cluster, 9, mode) * weight).sum().backward()
    on_triton()
    there = x.to(device).requires_grad_()
    (pooled_rows(there, cluster.to(device), 9, mode) * weight.to(device)).sum().backward()
    assert torch.equal(there.grad.cpu(), given.grad)


@pytest.mark.parametrize("mode", ["max", "average"])
def test_no_nodes_have_no_clusters(mode, device, on_triton):
    on_triton()
    x = torch.zeros(0, 3, device=device, requires_grad=True)
    rows = pooled_rows(x, torch.zeros(0, dtype=torch.int64, device=device), 0, mode)
    rows.sum().backward()
    assert rows.shape == x.grad.shape == (0, 3)
