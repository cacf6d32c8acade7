"""Small reads from open files: compiled, because a system call from Python costs more than the reading."""

from __future__ import annotations

import numpy as np
from numba import types

from nvsdata.kernels.compiling import njit

# the C library's function, on systems that have it
pread = types.ExternalFunction("pread", types.int64(types.int32, types.uintp, types.uintp, types.int64))


@njit
def read_samples(handle, begin, step, out):
    """Fill the rows of `out`, uint8 [N, size], with the bytes from `begin` on, one row every `step` bytes.

    Returns how many rows there were bytes for.
    """
    size = np.uintp(out.shape[1])
    for i in range(out.shape[0]):
        if pread(handle, out.ctypes.data + np.uintp(i) * size, size, begin + i * step) != size:
            return i
    return out.shape[0]
