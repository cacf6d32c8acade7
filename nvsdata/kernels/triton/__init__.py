"""Kernels for GPUs, written in Triton: tensors in and out.

Modules of this package import Triton, which comes with torch's builds for CUDA. Other modules therefore import them
within functions, after `usable` has returned True.
"""

from __future__ import annotations

import warnings
from functools import cache

import torch


def usable(x: torch.Tensor) -> bool:
    """Return True if these kernels accept a tensor: one on a GPU with Triton, of single or double precision.

    Autocast and `torch.use_deterministic_algorithms` are left to torch.
    """
    return (
        x.dtype in (torch.float32, torch.float64)
        and not torch.is_autocast_enabled("cuda")
        and not torch.are_deterministic_algorithms_enabled()
        and works(x.device)
    )


@cache
def works(device: torch.device) -> bool:
    """Return True for a GPU on which Triton can run a kernel; warn if Triton is installed but can't."""
    if device.type != "cuda":
        return False
    try:
        from nvsdata.kernels.triton.pool import mean_rows, segments
    except ImportError:
        return False
    try:
        node = torch.zeros(1, dtype=torch.int64, device=device)
        mean_rows(torch.ones(1, 1, device=device), *segments(node, 1))
    except Exception as error:  # of drivers, compilers and GPUs, each with its own class
        warnings.warn(f"torch is used instead of Triton, which can't run on {device}: {error}", stacklevel=2)
        return False
    return True
