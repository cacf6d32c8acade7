import numpy as np
import pytest

from nvsdata.kernels.order import is_sorted


@pytest.mark.parametrize("n", [0, 1, 2, 4_095, 4_096, 4_097, 9_000])
def test_rising_and_level_values_never_fall(n):
    assert is_sorted(np.arange(n) // 3)


@pytest.mark.parametrize("at", [1, 2, 4_095, 4_096, 4_097, 8_192, 8_999])
def test_one_fall_is_found_wherever_it_is(at):
    t = np.arange(9_000)
    t[at] = t[at - 1] - 1
    assert not is_sorted(t)
