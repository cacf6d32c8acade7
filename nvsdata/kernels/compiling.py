"""How kernels are compiled."""

from __future__ import annotations

import numba


def njit(function=None, **options):
    """numba's `njit`: what it compiles is kept on disk, and doesn't hold Python's lock while it runs."""
    return numba.njit(function, cache=True, nogil=True, **options)


@njit
def nothing():
    """Do nothing: for what numba loads at a first call, and the folder in which it keeps all kernels."""
