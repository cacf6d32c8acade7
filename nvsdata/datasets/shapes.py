"""What a sample is, in a few words."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch


def shape_of(sample: Any) -> str:
    """Kind and shape of a sample, such as "float32 [2, 34, 34]"; of a collection, also those of what is in it."""
    if isinstance(sample, (torch.Tensor, np.ndarray)):
        return f"{str(sample.dtype).removeprefix('torch.')} {list(sample.shape)}"
    if isinstance(sample, dict):
        return ", ".join(f"{key}: {shape_of(value)}" for key, value in sample.items())
    if isinstance(sample, (list, tuple)) and sample:
        return f"{len(sample)} x {shape_of(sample[0])}"
    return repr(sample).splitlines()[0]
