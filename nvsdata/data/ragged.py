"""Batches of samples of unequal size."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import torch

from nvsdata.data.events import Events, concatenate
from nvsdata.data.recording import Recording, as_events

Ragged = TypeVar("Ragged", bound="_Tensors")


def sensor_size_advice(sizes: Iterable[tuple[int, int]]) -> str:
    """Return the end of an error message about samples of several sensor sizes (width, height)."""
    several = sorted(set(sizes))
    shown = ", ".join(f"{width}x{height}" for width, height in several)
    largest = max(width for width, _ in several), max(height for _, height in several)
    # as for files of N-MNIST that are read one by one
    cause = "a file that doesn't state its sensor gets the smallest size that contains its events"
    cure = f"pass sensor_size={largest} to nvsdata.read, nvsdata.open or EventFolder"
    return f"have several sensor sizes, {shown}: {cause}, so {cure}"


class _Tensors:
    """Base class of data classes whose tensors are moved to a device together."""

    def to(self: Ragged, device: torch.device | str, non_blocking: bool = False) -> Ragged:
        """Return a copy on another device."""
        return self._of(lambda tensor: tensor.to(device, non_blocking=non_blocking))

    def pin_memory(self: Ragged) -> Ragged:
        """Return a copy in pinned memory; a DataLoader calls this."""
        return self._of(torch.Tensor.pin_memory)

    def _of(self: Ragged, change: Any) -> Ragged:
        changed = {
            name: change(value) if isinstance(value, torch.Tensor) else value for name, value in vars(self).items()
        }
        return type(self)(**changed)


@dataclass(frozen=True)
class Padded(_Tensors):
    """B tensors of unequal size, padded with zeros at the end of each axis.

    Args:
        values: [B, ...], along each axis as large as the largest sample.
        sizes: int64 [B, D], size of each sample along its D axes.

    Example:
        >>> batch = Padded.of([torch.ones(1), torch.ones(3)])
        >>> batch.values.tolist(), batch.lengths.tolist()
        ([[1.0, 0.0, 0.0], [1.0, 1.0, 1.0]], [1, 3])
    """

    values: torch.Tensor
    sizes: torch.Tensor

    @classmethod
    def of(cls, samples: Sequence[torch.Tensor]) -> Padded:
        """Make a batch of tensors with the same number of axes, at least one."""
        sizes = torch.tensor([sample.shape for sample in samples])
        values = samples[0].new_zeros((len(samples), *sizes.amax(0).tolist()))
        for sample, place in zip(samples, values, strict=True):
            place[tuple(slice(size) for size in sample.shape)] = sample
        return cls(values, sizes)

    @property
    def lengths(self) -> torch.Tensor:
        """Size of each sample along its first axis, such as its number of frames: int64 [B]."""
        return self.sizes[:, 0]

    @property
    def mask(self) -> torch.Tensor:
        """Mask of the values that aren't padding: bool, of the shape of `values`."""
        own = torch.ones_like(self.values, dtype=torch.bool)
        for axis in range(self.sizes.shape[1]):
            size = self.values.shape[axis + 1]
            within = torch.arange(size, device=own.device) < self.sizes[:, axis, None]
            own &= within.view(len(own), *(size if other == axis else 1 for other in range(self.sizes.shape[1])))
        return own


@dataclass(frozen=True)
class EventBatch(_Tensors):
    """The events of B samples, concatenated.

    Args:
        t: int64 [N], µs.
        x: int16 [N], pixels.
        y: int16 [N], pixels.
        p: uint8 [N], 1 for ON and 0 for OFF.
        offsets: int64 [B + 1]; sample b has the events `offsets[b]` to `offsets[b + 1]` - 1.
        sensor_sizes: B pairs (width, height).

    Example:
        >>> batch = EventBatch.of([Events([5], [1], [0], [1]), Events([7, 9], [0, 0], [1, 1], [0, 1])])
        >>> batch.offsets.tolist(), batch.starts.tolist()
        ([0, 1, 3], [5, 7])
    """

    t: torch.Tensor
    x: torch.Tensor
    y: torch.Tensor
    p: torch.Tensor
    offsets: torch.Tensor
    sensor_sizes: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, samples: Sequence[Events | Recording]) -> EventBatch:
        """Make a batch of at least one sample; recordings are decoded."""
        events = [as_events(sample) for sample in samples]
        columns = concatenate([each.columns for each in events])
        offsets = torch.tensor([0, *map(len, events)]).cumsum(0)
        tensors = Events.trusted(columns, (1, 1)).torch()
        return cls(**tensors, offsets=offsets, sensor_sizes=tuple(each.sensor_size for each in events))

    def __len__(self) -> int:
        """Return the number of samples B."""
        return len(self.sensor_sizes)

    @property
    def sensor_size(self) -> tuple[int, int]:
        """(width, height) of all samples; ValueError if they differ."""
        if len(set(self.sensor_sizes)) > 1:
            raise ValueError(f"samples {sensor_size_advice(self.sensor_sizes)}; or crop or resize them")
        return self.sensor_sizes[0]

    @property
    def starts(self) -> torch.Tensor:
        """Time of each sample's first event in µs, 0 if it has none: int64 [B]."""
        return self._times(self.offsets[:-1])

    @property
    def durations(self) -> torch.Tensor:
        """Time from each sample's first event to its last in µs: int64 [B]."""
        return self._times(self.offsets[1:] - 1) - self.starts

    def _times(self, at: torch.Tensor) -> torch.Tensor:
        """Return the times of the events with these indices [B]; 0 for samples without events."""
        empty = self.offsets.diff() == 0
        return torch.cat((self.t, self.t.new_zeros(1)))[at.masked_fill(empty, len(self.t))]

    @property
    def batch(self) -> torch.Tensor:
        """Number of each event's sample: int64 [N]."""
        return torch.repeat_interleave(self.offsets.diff())
