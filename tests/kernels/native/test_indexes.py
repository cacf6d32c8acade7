"""Bounds of indexes."""

import numpy as np
import pytest

from nvsdata.kernels.metrics.distances import sum_polarity


@pytest.mark.parametrize("width", [32_767, 32_768, 40_000])
def test_an_index_may_be_the_largest_of_its_type(width):
    x, none, p = np.array([32_767], np.int16), np.zeros(1, np.int16), np.ones(1, np.uint8)
    sums, touched = np.zeros((1, width), np.int32), np.zeros(1, np.int64)
    if width == 32_767:
        with pytest.raises(IndexError, match="an event is outside the frame"):
            sum_polarity(x, none, p, sums, touched)
        return
    assert sum_polarity(x, none, p, sums, touched) == 1
    assert sums[0, 32_767] == 1


def test_nothing_has_no_index():
    none = np.zeros(1, np.int16)
    with pytest.raises(IndexError):
        sum_polarity(none, none, np.ones(1, np.uint8), np.zeros((0, 5), np.int32), np.zeros(1, np.int64))
