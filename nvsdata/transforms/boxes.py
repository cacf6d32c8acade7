"""Pipelines for samples with boxes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from nvsdata.common import validation
from nvsdata.data.boxes import Boxes
from nvsdata.data.recording import wrong_type
from nvsdata.transforms.apply import followed, size_of
from nvsdata.transforms.compose import is_deterministic

OF_IMAGE = ("image_id", "size", "orig_size")  # of a target, as torchvision names them


@dataclass(frozen=True)
class WithBoxes:
    """Apply a transform to a sample, and move the boxes of its target along: a dataset's `transforms`.

    - `transform`: any of nvsdata's, such as a `Compose`

    Called with a sample (`Events`, a `Recording`, or an image) and a target, a mapping with `boxes` (float32 [N, 4]:
    left, top, right, bottom edges in pixels), it gives both. What flips, scales, rotates, shifts, slants, crops or
    resizes the sample does the same to the boxes. A rotated box becomes the smallest upright one around it; boxes are
    cut at the sensor's edges, and those of which nothing is left are dropped, together with their entries in other
    tensors [N, ...] and lists of N, such as `labels`; `image_id`, `size` and `orig_size` belong to the image. Functions
    of one's own that move events aren't followed, nor are transforms that run in a thread of their own.

    TypeError for a transform that isn't callable, and a target without boxes; ValueError for boxes of another shape,
    for masks and keypoints, which don't follow, and for a pipeline that moves the parts of a sample apart, such as
    `FourCrops`, or `Each` of a random transform.
    """

    transform: Callable[[Any], Any]

    def __post_init__(self) -> None:
        validation.transform(self.transform)

    def __call__(self, sample: Any, target: Any) -> tuple[Any, dict[str, Any]]:
        if not isinstance(target, Mapping) or "boxes" not in target:
            raise TypeError(f"a target with boxes is needed, such as NCaltech101(boxes=True) gives, not {target!r}")
        unmoved = {"masks", "keypoints"} & target.keys()
        if unmoved:
            raise ValueError(
                f"only boxes follow a sample, not {', '.join(sorted(unmoved))}: take them out of the target"
            )
        size = size_of(sample)
        if size is None:
            raise wrong_type("Events, a Recording or an image", sample)
        before, count = Boxes.of(target["boxes"], size), len(target["boxes"])
        with followed(before) as following:
            sample = self.transform(sample)
        after = following.boxes
        kept = {name: value if name in OF_IMAGE else _taken(value, after, count) for name, value in target.items()}
        return sample, {**kept, "boxes": after.edges}

    @property
    def deterministic(self) -> bool:
        """Whether the same sample always gives the same result; a subclass must declare it itself."""
        return type(self) is WithBoxes and is_deterministic(self.transform)


def _taken(value: Any, boxes: Boxes, count: int) -> Any:
    """Of a value that has an entry for each of `count` boxes, those of the boxes that are left."""
    if isinstance(value, list | tuple) and len(value) == count:
        return type(value)([value[i] for i in boxes.index.tolist()])
    if isinstance(value, torch.Tensor | np.ndarray) and value.shape[:1] == (count,):
        return value[boxes.index if isinstance(value, torch.Tensor) else boxes.index.numpy()]
    return value
