"""The N-Caltech101 dataset."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
import torch

from nvsdata.common.errors import FormatError
from nvsdata.datasets.facts import Archive, Info, Sample
from nvsdata.datasets.families import RandomSplitDataset
from nvsdata.datasets.indexing import PairTransform, Transform
from nvsdata.datasets.source import path_below

_MENDELEY = "https://data.mendeley.com/public-files/datasets/cy6cvx3ryv/files"
_ALL = Archive(
    "cy6cvx3ryv-1.zip",
    "5cf34932049665c4740c7c3fa126bc6b8a5e007691fdd3a4e3171d30f8908930",
    ("https://prod-dcd-datasets-cache-zipfiles.s3.eu-west-1.amazonaws.com/cy6cvx3ryv-1.zip",),
    "",
    3991470277,
)
BACKGROUND = "BACKGROUND_Google"
CLASSES = """
    BACKGROUND_Google Faces_easy Leopards Motorbikes accordion airplanes anchor ant barrel bass beaver binocular
    bonsai brain brontosaurus buddha butterfly camera cannon car_side ceiling_fan cellphone chair chandelier
    cougar_body cougar_face crab crayfish crocodile crocodile_head cup dalmatian dollar_bill dolphin dragonfly
    electric_guitar elephant emu euphonium ewer ferry flamingo flamingo_head garfield gerenuk gramophone grand_piano
    hawksbill headphone hedgehog helicopter ibis inline_skate joshua_tree kangaroo ketch lamp laptop llama lobster
    lotus mandolin mayfly menorah metronome minaret nautilus octopus okapi pagoda panda pigeon pizza platypus
    pyramid revolver rhino rooster saxophone schooner scissors scorpion sea_horse snoopy soccer_ball stapler
    starfish stegosaurus stop_sign strawberry sunflower tick trilobite umbrella watch water_lilly wheelchair
    wild_cat windsor_chair wrench yin_yang
""".split()


class BoundingBox(NamedTuple):
    """A bounding box in pixels: `x` (left edge), `y` (top edge), `width`, `height`."""

    x: int
    y: int
    width: int
    height: int


class NCaltech101(RandomSplitDataset):
    """N-Caltech101 (Orchard et al. 2015): Caltech101's images, recorded by an ATIS in three saccades.

    8,709 recordings of about 300 ms, `Caltech101/<class>/image_<id>.bin`. The images differ in size; the largest,
    240x180, is taken as the sensor's size. `box(i)` is the bounding box of sample i, if the annotations were
    downloaded.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all"; a random fifth of each class is for testing.
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        background: whether the background class is one of the classes: 101 with it, 100 without.
        boxes: whether targets are dicts of `boxes` (float32 [N, 4]: left, top, right and bottom edge in pixels; N is 0
            or 1) and `labels` (int64 [N]) instead of ints. As `transforms`, `T.WithBoxes(...)` moves boxes along with
            events.
        fold: seed of the random split, at least 0 (default 0).
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Example:
        >>> import nvsdata
        >>> train = nvsdata.NCaltech101("data/n-caltech101", "train")  # doctest: +SKIP
        >>> nvsdata.NCaltech101.info.sensor_size, len(nvsdata.NCaltech101.info.classes)
        ((240, 180), 101)
    """

    info = Info(
        name="n-caltech101",
        sensor_size=(240, 180),
        classes=tuple(CLASSES),
        page="https://www.garrickorchard.com/datasets/n-caltech101",
        license="CC BY 4.0 (as reported)",
        archives=(
            Archive(
                "Caltech101.zip",
                "66201824eabb0239c7ab992480b50ba3",
                (f"{_MENDELEY}/36b5c52a-b49d-4853-addb-a836a8883e49/file_downloaded",),
                "Caltech101",
                within=_ALL,
            ),
            Archive(
                "Caltech101_annotations.zip",
                "25e64cea645291e368db1e70f214988e",
                (),
                "Caltech101_annotations",
                optional=True,
            ),
        ),
        recordings=8_709,
        known_from="Caltech101's 9,144 images without the 435 of Faces; no source lists the counts per class",
        tree="Caltech101/<class>/image_<id>.bin",
    )

    def __init__(
        self,
        root: str | os.PathLike[str],
        split: str | None = None,
        transform: Transform | None = None,
        target_transform: Transform | None = None,
        download: bool = False,
        *,
        background: bool = True,
        fold: int | None = None,
        boxes: bool = False,
        train: bool | None = None,
        transforms: PairTransform | None = None,
        seed: int | None = None,
        errors: str = "raise",
    ) -> None:
        self.background, self.boxes = background, boxes
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

    def _classes(self) -> list[str]:
        return [name for name in self.info.classes if self.background or name != BACKGROUND]

    def found(self) -> list[Sample]:
        # annotations are also .bin files in class folders
        return [sample for sample in super().found() if not sample.stem.startswith("annotation")]

    def target(self, index: int) -> Any:
        if not self.boxes:
            return super().target(index)
        found = self.box(index)
        edges = [] if found is None else [[found.x, found.y, found.x + found.width, found.y + found.height]]
        target = {
            "boxes": torch.tensor(edges, dtype=torch.float32).reshape(-1, 4),
            "labels": torch.full((len(edges),), self.targets[index]),
        }
        return target if self.target_transform is None else self.target_transform(target)

    def box(self, index: int) -> BoundingBox | None:
        """Return the bounding box of a sample, with negative corners moved to 0; None if it has no annotation.

        Args:
            index: index of the sample.

        Raises:
            FormatError: the annotation is damaged.
        """
        sample = self.samples[index]
        wanted = "annotation" + sample.stem.removeprefix("image") + ".bin"
        for folder, names in self.listing.items():
            if self._label_of(folder) == sample.label and wanted in names:
                where = path_below(folder, wanted)
                return _box(where, self.source.data(where))
        return None


def _box(name: str, data: bytes) -> BoundingBox:
    """Decode an annotation, little-endian int16: rows, columns, then x and y of each corner."""
    values = np.frombuffer(data[: len(data) // 2 * 2], "<i2")
    if values.size < 10 or values[0] != 2 or values[1] < 4:
        raise FormatError(
            name, "not an annotation: it doesn't begin with a box of 2 rows and 4 columns or more", offset=0
        )
    x, y, right, bottom = (max(int(values[i]), 0) for i in (2, 3, 4, 7))
    return BoundingBox(x, y, right - x, bottom - y)
