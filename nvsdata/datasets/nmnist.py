"""N-MNIST."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from nvsdata.datasets.base import Archive, EventDataset, Info, Sample, recordings_in

_MENDELEY = "https://data.mendeley.com/public-files/datasets/468j46mzdv/files"


class NMNIST(EventDataset):
    """N-MNIST (Orchard et al. 2015): MNIST's digits seen by an ATIS in three saccades, 34x34 pixels.

    60,000 recordings for training and 10,000 for testing, about 4,100 events over 300 ms each, in
    `Train/<digit>/<id>.bin` and `Test/<digit>/<id>.bin` below `root` (or below an `N-MNIST` or
    `NMNIST` folder in it). The polarity bit is handed out as it is in the file.

    `split` is "train", "test" or "all". FileNotFoundError if `root` or its split isn't there.
    """

    info = Info(
        name="n-mnist",
        sensor_size=(34, 34),
        classes=tuple("0123456789"),
        page="https://www.garrickorchard.com/datasets/n-mnist",
        licence="CC BY-SA 4.0",
        archives=(
            Archive(
                "Train.zip",
                "20959b8e626244a1b502305a9e6e2031",
                (f"{_MENDELEY}/39c25547-014b-4137-a934-9d29fa53c7a0/file_downloaded",),
                "Train",
            ),
            Archive(
                "Test.zip",
                "69ca8762b2fe404d9b9bad1103e97832",
                (f"{_MENDELEY}/05a4d654-7e03-4c15-bdfa-9bb2bcbea494/file_downloaded",),
                "Test",
            ),
        ),
    )

    def _samples(self) -> Iterator[Sample]:
        for name in ("Train", "Test") if self.split == "all" else (self.split.capitalize(),):
            folder = self._folder(name)
            for label, digit in enumerate(self.classes):
                for path in recordings_in(folder / digit):
                    yield Sample(path, label)

    def _folder(self, name: str) -> Path:
        for home in (self.root, self.root / "N-MNIST", self.root / "NMNIST"):
            if (home / name).is_dir():
                return home / name
        raise FileNotFoundError(f"no folder {name} below {self.root}; {self._how_to_get()}")
