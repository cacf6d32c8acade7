"""N-MNIST without the motion of its camera."""

from __future__ import annotations

import numpy as np
import pytest

from nvsdata import Events
from nvsdata.datasets.nmnist import stabilize


@pytest.mark.parametrize(
    ("t", "dx", "dy"),
    [
        (0, 0, 0),
        (30_000, 1, 2),
        (60_000, 2, 4),
        (105_000, 3.5, 7),
        (135_000, 4.5, 5),
        (165_000, 5.5, 3),
        (210_000, 7, 0),
        (225_000, 6, 0),
        (240_000, 5, 0),
        (315_000, 0, 0),
        (400_000, 0, 0),
    ],
)
def test_three_saccades_are_undone(t, dx, dy):
    """By (3.5, 7) pixels in 105 ms, then by (3.5, -7), then by (-7, 0)."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(34), np.arange(34)))
    p = (x + y) % 2
    still = stabilize(Events(np.full(x.size, t), x, y, p, (34, 34)))
    expected = [
        (t, round(a - dx), round(b - dy), c)
        for a, b, c in zip(x.tolist(), y.tolist(), p.tolist(), strict=True)
        if 0 <= round(a - dx) <= 33 and 0 <= round(b - dy) <= 33
    ]
    assert list(zip(*(column.tolist() for column in still.columns), strict=True)) == expected
    assert still.sensor_size == (34, 34)


def test_an_edge_of_each_side_is_kept():
    found = stabilize(Events([0] * 4, [0, 19, 0, 19], [0, 0, 9, 9], [0, 1, 0, 1], (20, 10)))
    assert (found.x.tolist(), found.y.tolist()) == ([0, 19, 0, 19], [0, 0, 9, 9])
    later = stabilize(Events([210_000] * 3, [6, 7, 19], [0, 0, 9], [0, 1, 0], (20, 10)))
    assert (later.x.tolist(), later.y.tolist()) == ([0, 12], [0, 9])
