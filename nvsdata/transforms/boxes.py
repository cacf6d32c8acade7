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
from nvsdata.transforms.apply import size_of, with_boxes
from nvsdata.transforms.compose import is_deterministic

OF_IMAGE = ("image_id", "size", "orig_size")  # entries of a target that belong to the image, with torchvision's names


@dataclass(frozen=True)
class WithBoxes:
    """Apply a transform to a sample, and move the boxes of its target accordingly.

    It is the argument `transforms` of a dataset. Transforms that flip, scale, rotate, shift, slant, crop or resize the
    sample do the same to the boxes. A rotated box becomes the smallest upright one around it. Boxes are cut at the
    sensor's edges. Boxes outside the sensor are dropped, together with their entries in the target's other tensors
    [N, ...] and lists of N, such as `labels`; `image_id`, `size` and `orig_size` belong to the image and stay.

    A function or class of your own leaves boxes where they are. If it moves events, or applies transforms that do, give
    it a method `with_boxes(sample, boxes)` that returns both.

    Args:
        transform: Any transform of nvsdata, such as a `Compose`.

    Returns:
        The changed sample, and the target with `boxes` float32 [N, 4]. The call takes a sample (`Events`, a
        `Recording`, or an image) and a target, a mapping with `boxes` (left, top, right, bottom edges in pixels).

    Raises:
        TypeError: The transform isn't callable, or the target has no boxes.
        ValueError: The boxes have another shape; the target has masks or keypoints, which nothing moves; or the
            pipeline moves the parts of a sample differently, such as `FourCrops`, or `Each` of a random transform.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> flip = T.WithBoxes(T.RandomFlip(p=1))
        >>> events, target = flip(nvsdata.example(), {"boxes": [[0, 0, 40, 30]]})
        >>> target["boxes"]
        tensor([[200.,   0., 240.,  30.]])
    """

    transform: Callable[[Any], Any]

    def __post_init__(self) -> None:
        validation.transform(self.transform)

    def __call__(self, sample: Any, target: Any) -> tuple[Any, dict[str, Any]]:
        if not isinstance(target, Mapping) or "boxes" not in target:
            raise TypeError(f"a target with boxes is needed, such as NCaltech101(boxes=True) returns, not {target!r}")
        unmoved = {"masks", "keypoints"} & target.keys()
        if unmoved:
            raise ValueError(
                f"only boxes follow a sample, not {', '.join(sorted(unmoved))}: take them out of the target"
            )
        size = size_of(sample)
        if size is None:
            raise wrong_type("sample", "Events, a Recording or an image", sample)
        sample, moved = with_boxes(self.transform, sample, Boxes.of(target["boxes"], size))
        count = len(target["boxes"])
        kept = {name: value if name in OF_IMAGE else _kept(value, moved, count) for name, value in target.items()}
        return sample, {**kept, "boxes": moved.edges}

    @property
    def deterministic(self) -> bool:
        """True if equal samples have equal results. A subclass must declare it itself."""
        return type(self) is WithBoxes and is_deterministic(self.transform)


def _kept(value: Any, boxes: Boxes, count: int) -> Any:
    """Select the entries of the remaining boxes from a value that has an entry for each of the original `count` boxes.

    Other values are returned unchanged.
    """
    if isinstance(value, list | tuple) and len(value) == count:
        return type(value)([value[i] for i in boxes.index.tolist()])
    if isinstance(value, torch.Tensor | np.ndarray) and value.shape[:1] == (count,):
        return value[boxes.index if isinstance(value, torch.Tensor) else boxes.index.numpy()]
    return value
