"""From N-MNIST's files to frames through a DataLoader with two workers: nvsdata and tonic, in turns.

    python recipes/bench/loading.py --root N-MNIST

Frames are [10, 2, 34, 34] per recording, batches hold 50. "fresh": new workers for each epoch, as a DataLoader has them
unless it's told otherwise; "persistent": the workers of the epoch before. Seconds per 1,000 recordings, medians; the
first epoch, which loads what is loaded once, is not counted, but is told.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tonic
import torch
from torch.utils.data import DataLoader, Dataset

from nvsdata import NMNIST
from nvsdata import transforms as T

EPOCHS, BATCH, BINS = 7, 50, 10


class _Tonic(Dataset[tuple[Any, int]]):
    """The same files, read and made into frames by tonic."""

    def __init__(self, files: list[Path], labels: list[int]) -> None:
        self.files, self.labels = files, labels
        self.kind = tonic.datasets.NMNIST.dtype
        self.frames = tonic.transforms.ToFrame(sensor_size=(34, 34, 2), n_time_bins=BINS)

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, index: int) -> tuple[Any, int]:
        events = tonic.io.read_mnist_file(self.files[index], dtype=self.kind)
        return torch.from_numpy(self.frames(events)).float(), self.labels[index]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", required=True, type=Path, help="N-MNIST's folder")
    args = parser.parse_args()
    ours = NMNIST(args.root, "all", transform=T.ToFrames(BINS))
    theirs = _Tonic([args.root / sample.name for sample in ours.samples], ours.targets)
    datasets: dict[str, Dataset[Any]] = {"nvsdata": ours, "tonic": theirs}
    loaders = {name: _loader(dataset, persistent_workers=True) for name, dataset in datasets.items()}
    for kind, make in {
        "fresh": lambda name: _loader(datasets[name]),
        "persistent": lambda name: loaders[name],
    }.items():
        _race(kind, make, len(ours) / 1_000)


def _loader(dataset: Dataset[Any], **how: Any) -> DataLoader[Any]:
    return DataLoader(dataset, BATCH, shuffle=True, num_workers=2, **how)


def _race(kind: str, make: Callable[[str], DataLoader[Any]], thousands: float) -> None:
    spent: dict[str, list[float]] = {"nvsdata": [], "tonic": []}
    for _ in range(EPOCHS + 1):
        for name, times in spent.items():
            start = time.perf_counter()
            for frames, _ in make(name):
                assert frames.shape[1:] == (BINS, 2, 34, 34)
            times.append((time.perf_counter() - start) / thousands)
    medians = {name: statistics.median(times[1:]) for name, times in spent.items()}
    for name, times in spent.items():
        print(f"{kind:10} {name:8} {medians[name]:.3f} s per 1,000 (the first epoch {times[0]:.3f})")
    print(f"{kind:10} ratio {medians['tonic'] / medians['nvsdata']:.2f}")


if __name__ == "__main__":
    main()
