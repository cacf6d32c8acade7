"""Frames of N-MNIST by tonic's own dataset, and with its caches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tonic import DiskCachedDataset, MemoryCachedDataset, datasets, transforms


class Digits(datasets.NMNIST):  # type: ignore[misc]
    """Tonic's dataset of a folder that isn't the whole N-MNIST, and has another name."""

    def __init__(self, root: Path, bins: int) -> None:
        self._root = root
        super().__init__(str(root), transform=transforms.ToFrame(sensor_size=self.sensor_size, n_time_bins=bins))

    def _check_exists(self) -> bool:
        # otherwise it would download the dataset, whose folder this isn't
        self.location_on_system = str(self._root)
        return True


def on_disk(root: Path, bins: int) -> Any:
    """Return the dataset with its frames cached on disk."""
    return DiskCachedDataset(Digits(root, bins), str(root.parent / f"tonic-{bins}"))


def in_memory(root: Path, bins: int) -> Any:
    """Return the dataset with its frames cached in memory, by each worker for itself."""
    return MemoryCachedDataset(Digits(root, bins))
