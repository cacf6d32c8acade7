"""Random bits that depend only on a number (splitmix64, Steele et al. 2014)."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

STEP, FIRST, SECOND = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB  # odd numbers of well-mixed bits
_U = np.uint64


@njit
def random_bits(state):
    """64 random bits of a state, uint64; the next state is `state + STEP`."""
    z = (state ^ (state >> _U(30))) * _U(FIRST)
    z = (z ^ (z >> _U(27))) * _U(SECOND)
    return z ^ (z >> _U(31))
