"""Cells of a grid, and boxes, by hand."""

import pytest
import torch

from nvsdata.data.boxes import Boxes
from nvsdata.data.grid import cells, check_cluster, grid_shape, to_grid


def test_how_many_clusters_cover_a_sensor():
    assert grid_shape((34, 34), (4, 4)) == (9, 9)
    assert grid_shape((32, 33), (4, 8)) == (8, 5)
    assert grid_shape((3, 3), (5, 3)) == (1, 1)
    check_cluster((1, 1))
    for wrong in ((0, 1), (1, 0)):
        with pytest.raises(ValueError, match=rf"at least 1 pixel, not \({wrong[0]}, {wrong[1]}\)"):
            check_cluster(wrong)


def test_cells_are_counted_row_by_row():
    pos = torch.tensor([[0, 0], [3.9, 0], [4, 0], [11, 0], [0, 2.9], [0, 3], [5, 4], [11.9, 5.9]])
    assert cells(pos, (4, 3), (3, 2)).tolist() == [0, 0, 1, 2, 0, 3, 4, 5]
    # what lies outside goes to the border
    beyond = torch.tensor([[-1, 0], [12, 0], [99, 99], [0, -9], [0, 9], [float("nan"), 4], [4, float("nan")]])
    assert cells(beyond, (4, 3), (3, 2)).tolist() == [0, 2, 5, 0, 3, 3, 1]
    assert cells(beyond, (4, 3), (2, 4)).tolist() == [0, 1, 7, 0, 6, 2, 1]


def test_features_stand_in_their_cells():
    generator = torch.Generator().manual_seed(0)
    x, pos = torch.rand(40, 2, generator=generator), torch.rand(40, 2, generator=generator) * torch.tensor([12.0, 6.0])
    batch = torch.arange(40) * 6 // 40
    found = to_grid(x, pos, batch, 6, 3, (4, 3), (3, 2))
    assert found.shape == (2, 2, 3, 2, 3)
    expected = torch.zeros(2, 2, 3, 2, 3)
    for features, (across, down), graph in zip(x, pos.tolist(), batch.tolist(), strict=True):
        expected[graph // 3, :, graph % 3, int(down // 3), int(across // 4)] += features
    torch.testing.assert_close(found, expected)


def boxes(*edges):
    return Boxes.of(list(edges), (20, 10))


def test_boxes_are_cut_at_the_sensor_and_the_empty_ones_dropped():
    made = boxes(
        [1, 2, 3, 4], [-5, -5, 2, 2], [18, 8, 25, 12], [3, 3, 3, 5], [3, 3, 5, 3], [20, 0, 25, 5], [0, 0, 1, 1]
    )
    assert made.edges.tolist() == [[1, 2, 3, 4], [0, 0, 2, 2], [18, 8, 20, 10], [0, 0, 1, 1]]
    assert made.index.tolist() == [0, 1, 2, 6]
    assert boxes().edges.shape == (0, 4)
    for wrong in ([[1, 2, 3]], [[3, 0, 2, 5]], [[0, 3, 5, 2]], [1, 2, 3, 4], [[[1, 2, 3, 4]] * 4]):
        with pytest.raises(ValueError, match=r"^boxes must be \[N, 4\] of left, top, right and bottom edges, not "):
            Boxes.of(wrong, (20, 10))


def test_corners_of_boxes_there_and_back():
    made = boxes([1, 2, 5, 4], [0, 0, 2, 2])
    assert made.pos.tolist()[:4] == [[0.5, 1.5], [4.5, 1.5], [0.5, 3.5], [4.5, 3.5]]
    assert made.moved(made.pos).equal(made)
    assert made.moved(made.pos + torch.tensor([14.0, 5.0])).edges.tolist() == [[15, 7, 19, 9], [14, 5, 16, 7]]
    seen = made.seen(1.0, 1.0, (2.0, 0.5), (7, 5))
    assert seen.edges.tolist() == [[0, 0.5, 7, 1.5], [0, 0, 2, 0.5]]
    assert seen.sensor_size == (7, 5)
    assert made.seen(2.0, 0.0, (1.0, 1.0), (20, 10)).index.tolist() == [0]


def test_which_boxes_are_the_same():
    made = boxes([1, 2, 5, 4], [0, 0, 2, 2])
    assert made.equal(boxes([1, 2, 5, 4], [0, 0, 2, 2]))
    assert not made.equal(boxes([1, 2, 5, 4], [0, 0, 2, 3]))
    for size in ((20, 11), (20, 9), (21, 10), (19, 10)):
        assert not made.equal(Boxes(made.edges, size, made.index))
    assert not made.equal(Boxes(made.edges, (20, 10), made.index.flip(0)))
