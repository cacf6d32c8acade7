"""The N-CARS dataset."""

from __future__ import annotations

from typing import ClassVar

from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.facts import Archive, Info, expected_names


class NCARS(EventDataset):
    """N-CARS (Sironi et al. 2018): crops of cars and background from the recordings of an ATIS, 100 ms each.

    7,940 cars and 7,482 backgrounds for training, 4,396 and 4,211 for testing, in
    `n-cars_train/{cars,background}/obj_<id>_td.dat` and `n-cars_test`. The crops differ in size; the largest,
    120x100, is taken as the sensor's size. Classes: background 0, cars 1. Recordings are numbered in order of a drive,
    so neighboring numbers often show the same car or place: `hold_out` holds out the highest numbers of each class.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all".
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        fold: must be None: there is one split.
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Example:
        >>> import nvsdata
        >>> train = nvsdata.NCARS("data/n-cars", "train")  # doctest: +SKIP
        >>> nvsdata.NCARS.info.sensor_size, len(nvsdata.NCARS.info.classes)
        ((120, 100), 2)
    """

    info = Info(
        name="n-cars",
        sensor_size=(120, 100),
        classes=("background", "cars"),
        page="https://www.prophesee.ai/2018/03/13/dataset-n-cars/",
        license="Prophesee's, for non-commercial research (as reported)",
        archives=(
            Archive("Prophesee_Dataset_n_cars.zip", "553ce464d6e5e617b3c21ce27c19368e", (), "n-cars", 450543128),
        ),
        recordings=24_029,
        expected_counts=(
            expected_names("background", "obj_{:06d}_td", range(4_211, 11_693), "train"),
            expected_names("cars", "obj_{:06d}_td", range(4_396, 12_336), "train"),
            expected_names("background", "obj_{:06d}_td", range(4_211), "test"),
            expected_names("cars", "obj_{:06d}_td", range(4_396), "test"),
        ),
        known_from="a public program that reads the dataset",
        tree="n-cars_train/<class>/obj_<id>_td.dat and n-cars_test/<class>/obj_<id>_td.dat",
    )
    in_scenes: ClassVar[bool] = True
    aliases: ClassVar[dict[str, str]] = {"car": "cars"}
