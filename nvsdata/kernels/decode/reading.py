"""Small reads from open files: compiled, because a system call from Python costs more than the reading."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def read_samples(handle: int, begin: int, step: int, out: np.ndarray) -> int:
    """Fill the rows of `out`, uint8 [N, size], with the bytes from `begin` on, one row every `step` bytes.

    Returns the number of rows that there were bytes for: 0 on systems without `os.pread`.
    """
    count: int = _native.read_samples(handle, begin, step, out)
    return count
