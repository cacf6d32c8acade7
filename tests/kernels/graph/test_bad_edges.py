"""Arrays of wrong sizes, and indexes out of range: errors, never a crash."""

import numpy as np
import pytest

from nvsdata.kernels.graph import edges, pool, spline

U = np.zeros((2, 2), np.float32)
X = np.ones((3, 1), np.float32)


def ints(*values):
    return np.array(values, np.int64)


@pytest.mark.parametrize("bad", [-1, 3, 2**31, 2**63 - 1, -(2**63)])
@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("size", [1, 5])
def test_edges_of_other_nodes(bad, end, size):
    ends = [ints(0, 1), ints(1, 2)]
    ends[end][end] = bad
    for call in (
        lambda: spline.dense_sums(*ends, U, size, X),
        lambda: spline.dense_gradient(*ends, U, size, np.ones((3 * size**2, 1), np.float32), 3),
        lambda: spline.spline_plan(*ends, U, size, 3),
        lambda: pool.merged_edges(*ends, ints(0, 0, 1), 2),
    ):
        with pytest.raises(IndexError):
            call()


@pytest.mark.parametrize("bad", [-1, 3, 2**31 - 1, -(2**31)])
def test_rows_that_do_not_exist(bad):
    good, bad, share = np.zeros(1, np.int32), np.array([bad], np.int32), np.ones(1, np.float32)
    for into, of in ((bad, good), (good, bad)):
        with pytest.raises(IndexError):
            spline.add_shares(X.copy(), into, X, of, share)
    with pytest.raises(IndexError):
        spline.add_rows(X.copy(), bad.astype(np.int64), X[:1])
    for pooled in (pool.max_rows, pool.mean_rows):
        with pytest.raises(IndexError):
            pooled(X, np.array([0, bad[0], 1]), 2)
    with pytest.raises(IndexError):
        pool.max_rows_back(X[:1], bad[:, None], 3)


def test_sizes_that_differ():
    source, target, one = ints(0, 1), ints(1, 2), np.zeros(1, np.int32)
    for call in (
        lambda: spline.dense_sums(source, target[:1], U, 5, X),
        lambda: spline.spline_plan(source, target, U[:1], 5, 3),
        lambda: spline.spline_plan(source, target, U, 0, 3),
        lambda: spline.spline_plan(source, target, np.zeros((2, 40), np.float32), 5, 3),
        lambda: spline.dense_gradient(source, target, U, 5, X, 3),
        lambda: spline.add_shares(X.copy(), one, X, one[:0], np.ones(1, np.float32)),
        lambda: spline.add_rows(X.copy(), source, X),
        lambda: pool.merged_edges(source, target[:1], ints(0, 0, 0), 1),
        lambda: pool.merged_edges(source, target[::-1], ints(0, 0, 0), 1),
        lambda: pool.max_rows(X, source, 2),
        lambda: pool.mean_rows(X, source, 2),
        lambda: pool.max_rows_back(X, np.zeros((2, 1), np.int32), 3),
    ):
        with pytest.raises(ValueError, match=r"\w"):
            call()


@pytest.mark.parametrize("ptr", [(), (1, 3), (0, 2), (0, 4), (0, 2, 1, 3), (0, -1, 3), (0, 2**62, 3)])
def test_graphs_that_do_not_have_all_nodes(ptr):
    with pytest.raises(ValueError, match=r"ptr|clusters"):
        pool.clusters(np.zeros((3, 2), np.float32), ints(0, 1, 2), ints(*ptr), 2, 2, 4, 4)


@pytest.mark.parametrize("sizes", [(0, 2, 4, 4), (2, 2, 0, 4), (2, 2, 2**32, 2**32), (2, 2, -1, -1)])
def test_grids_that_do_not_exist(sizes):
    with pytest.raises(ValueError, match="no clusters"):
        pool.clusters(np.zeros((3, 2), np.float32), ints(0, 1, 2), ints(0, 3), *sizes)


def test_a_cluster_without_nodes():
    best, where = pool.max_rows(X, ints(0, 2, 2), 3)
    assert best.tolist() == [[1], [0], [1]]
    assert where.tolist() == [[0], [-1], [1]]


@pytest.mark.parametrize("wrong", [-1, 3, 4])
@pytest.mark.parametrize("end", [0, 1])
def test_edges_end_at_nodes_that_exist(wrong, end):
    edge = [np.array([2]), np.array([2])]
    u = np.zeros((1, 2), np.float32)
    assert edges.check_edges(*edge, u, 3) == edges.GROUPED
    edge[end][0] = wrong
    assert edges.check_edges(*edge, u, 3) == edges.NO_SUCH_NODE
