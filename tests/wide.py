"""Events on sensors that are wider and higher than one byte can count."""

import numpy as np

from nvsdata import Events

LARGE = ((346, 260), (1280, 720))


def corners(size, n=400):
    """Events anywhere on the sensor and along its last column and row, in its corners first and last; t from 1."""
    width, height = size
    rng = np.random.default_rng(0)
    x, y = rng.integers(0, width, n), rng.integers(0, height, n)
    x[::5], y[2::5] = width - 1, height - 1
    x[:4], y[:4] = (0, width - 1, 0, width - 1), (0, 0, height - 1, height - 1)
    x[-1], y[-1] = width - 1, height - 1
    return Events(1 + np.arange(n) * 20, x, y, rng.integers(0, 2, n), size)
