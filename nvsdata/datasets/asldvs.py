"""ASL-DVS."""

from __future__ import annotations

from typing import ClassVar

from nvsdata.datasets.facts import Archive, Holding, Info
from nvsdata.datasets.families import BottomOriginDataset, RandomSplitDataset


class ASLDVS(BottomOriginDataset, RandomSplitDataset):
    """ASL-DVS (Bi et al. 2019): 24 letters of American Sign Language, a DAVIS240C, 240x180.

    100,800 recordings of about 100 ms and 28,000 events, `<letter>/<letter>_<id>.mat`, letters a to y
    without j. The files count y from the bottom of the sensor; here it counts from the top.

    - `split`: "train" (default), "test" or "all"; a random fifth of each class is for testing
    - `fold`: seed of the random split, at least 0 (default 0)
    - other parameters: those of `EventDataset`
    """

    info = Info(
        name="asl-dvs",
        sensor_size=(240, 180),
        classes=tuple("abcdefghiklmnopqrstuvwxy"),
        page="https://www.dropbox.com/sh/ibq0jsicatn7l6r/AACNrNELV56rs1YInMWUs9CAa",
        license="not stated",
        # the host makes a new zip for each download, so its hash differs each time
        archives=(Archive("ICCV2019_DVS_dataset.zip", "", (), "ICCV2019_DVS_dataset", 5807293496),),
        recordings=100_800,
        holds=tuple(Holding(letter, 4_200) for letter in "abcdefghiklmnopqrstuvwxy"),
        known_from="the authors",
        tree="<letter>/<letter>_<id>.mat",
    )
    aliases: ClassVar[dict[str, str]] = {f"Yin Bi - {letter}": letter for letter in "abcdefghiklmnopqrstuvwxy"}
