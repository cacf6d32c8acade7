"""The N-MNIST dataset."""

from __future__ import annotations

import os

import numpy as np

from nvsdata.data.events import Columns, Events
from nvsdata.data.recording import Recording
from nvsdata.data.views import Mapped, Slice
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.facts import Archive, ExpectedCount, Info, expected_names
from nvsdata.datasets.indexing import PairTransform, Transform

_MENDELEY = "https://data.mendeley.com/public-files/datasets/468j46mzdv/files"
_BOTH = Archive(
    "468j46mzdv-1.zip",
    "e6964c15ef4013c91127790ea570d46200778262b9f5f8acd5c1366099d8e351",
    ("https://prod-dcd-datasets-cache-zipfiles.s3.eu-west-1.amazonaws.com/468j46mzdv-1.zip",),
    "",
    1178661068,
)
# recordings of each digit
COUNTS = {
    "train": (5923, 6742, 5958, 6131, 5842, 5421, 5918, 6265, 5851, 5949),
    "test": (980, 1135, 1032, 1010, 982, 892, 958, 1028, 974, 1009),
}
FIRST_SACCADE_US = 100_000
SACCADE_US = 105_000


class NMNIST(EventDataset):
    """N-MNIST (Orchard et al. 2015): MNIST's digits, recorded by an ATIS in three saccades, 34x34 pixels.

    60,000 recordings for training and 10,000 for testing, about 4,100 events over 300 ms each, in
    `Train/<digit>/<id>.bin` and `Test/<digit>/<id>.bin` below `root`. The polarity is the file's bit, unchanged.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all".
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        first_saccade: whether to keep only the events of the first 100 ms.
        stabilized: whether to remove the camera's motion from the coordinates; see `stabilize`.
        fold: must be None: there is one split.
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Raises:
        FileNotFoundError: `root` or its split doesn't exist.

    Example:
        >>> import nvsdata
        >>> train = nvsdata.NMNIST("data/n-mnist", "train")  # doctest: +SKIP
        >>> nvsdata.NMNIST.info.sensor_size, len(nvsdata.NMNIST.info.classes)
        ((34, 34), 10)
    """

    info = Info(
        name="n-mnist",
        sensor_size=(34, 34),
        classes=tuple("0123456789"),
        page="https://www.garrickorchard.com/datasets/n-mnist",
        license="CC BY-SA 4.0",
        archives=(
            Archive(
                "Train.zip",
                "20959b8e626244a1b502305a9e6e2031",
                (f"{_MENDELEY}/39c25547-014b-4137-a934-9d29fa53c7a0/file_downloaded",),
                "Train",
                within=_BOTH,
            ),
            Archive(
                "Test.zip",
                "69ca8762b2fe404d9b9bad1103e97832",
                (f"{_MENDELEY}/05a4d654-7e03-4c15-bdfa-9bb2bcbea494/file_downloaded",),
                "Test",
                within=_BOTH,
            ),
        ),
        recordings=70_000,
        expected_counts=tuple(
            ExpectedCount(str(digit), count, part)
            for part, counts in COUNTS.items()
            for digit, count in enumerate(counts)
        )
        + tuple(expected_names("", "{:05d}", range(1, sum(counts) + 1), part) for part, counts in COUNTS.items()),
        known_from="counts and numbers are MNIST's",
        tree="Train/<digit>/<id>.bin and Test/<digit>/<id>.bin",
    )

    def __init__(
        self,
        root: str | os.PathLike[str],
        split: str | None = None,
        transform: Transform | None = None,
        target_transform: Transform | None = None,
        download: bool = False,
        *,
        first_saccade: bool = False,
        stabilized: bool = False,
        fold: int | None = None,
        train: bool | None = None,
        transforms: PairTransform | None = None,
        seed: int | None = None,
        errors: str = "raise",
    ) -> None:
        self.first_saccade, self.stabilized = first_saccade, stabilized
        super().__init__(
            root,
            split,
            transform,
            target_transform,
            download,
            fold=fold,
            train=train,
            transforms=transforms,
            seed=seed,
            errors=errors,
        )

    def _view(self, recording: Recording) -> Recording:
        if self.first_saccade:
            recording = Slice(recording, 0, FIRST_SACCADE_US)
        return Mapped(recording, stabilize) if self.stabilized else recording


def stabilize(events: Events) -> Events:
    """Undo N-MNIST's saccades as the dataset's authors do, so that the digit doesn't move.

    In the first 105 ms the digit moves by (3.5, 7) pixels, in the next 105 ms by (3.5, -7), then by (-7, 0).

    Args:
        events: events of a recording, with the times of its file.

    Returns:
        The moved events, without those that leave the sensor.
    """
    one, two, three = (np.clip(events.t - k * SACCADE_US, 0, SACCADE_US) / SACCADE_US for k in range(3))
    # the authors count pixels from 1 before they round; counting from 0 doesn't change x
    x = np.rint(events.x - 3.5 * one - 3.5 * two + 7 * three)
    y = np.rint(events.y - 7 * one + 7 * two)
    width, height = events.sensor_size
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    columns = Columns(events.t[inside], x[inside].astype(np.int16), y[inside].astype(np.int16), events.p[inside])
    return events.of(columns)
