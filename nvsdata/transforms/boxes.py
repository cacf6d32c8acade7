"""Pipelines for samples with boxes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import torch

from nvsdata.data.boxes import Boxes
from nvsdata.transforms.compose import is_deterministic
from nvsdata.transforms.together import followed


@dataclass(frozen=True)
class WithBoxes:
    """Apply a transform to a sample, and move the boxes of its target along: a dataset's `transforms`.

    - `transform`: any of nvsdata's, such as a `Compose`

    Called with a sample (`Events`, a `Recording`, or an image) and a target, a mapping with `boxes` (float32 [N, 4]:
    left, top, right, bottom edges in pixels), it gives both. What flips, scales, rotates, shifts, slants, crops or
    resizes the sample does the same to the boxes. A rotated box becomes the smallest upright one around it; boxes are
    cut at the sensor's edges, and those of which nothing is left are dropped, together with their entries in other
    tensors [N, ...] of the target, such as `labels`.

    TypeError for a transform that isn't callable, and a target without boxes; ValueError for boxes of another shape,
    and for a pipeline that moves the parts of a sample apart, such as `FourCrops`, or `Each` of a random transform.
    """

    transform: Callable[[Any], Any]

    def __post_init__(self) -> None:
        if not callable(self.transform):
            raise TypeError(f"a transform must be callable, not {self.transform!r}")

    def __call__(self, sample: Any, target: Any) -> tuple[Any, dict[str, Any]]:
        if not isinstance(target, Mapping) or "boxes" not in target:
            raise TypeError(f"a target with boxes is needed, such as NCaltech101(boxes=True) gives, not {target!r}")
        before = Boxes.of(target["boxes"], _sensor_size(sample))
        with followed(before) as following:
            sample = self.transform(sample)
        after, count = following.boxes, len(before.edges)
        kept = {
            name: value[after.index] if isinstance(value, torch.Tensor) and value.shape[:1] == (count,) else value
            for name, value in target.items()
        }
        return sample, {**kept, "boxes": after.edges}

    @property
    def deterministic(self) -> bool:
        """Whether the same sample always gives the same result; a subclass must declare it itself."""
        return type(self) is WithBoxes and is_deterministic(self.transform)


def _sensor_size(sample: Any) -> tuple[int, int]:
    size = getattr(sample, "sensor_size", None)
    return (sample.shape[-1], sample.shape[-2]) if size is None else size
