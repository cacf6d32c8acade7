"""The ASL-DVS dataset."""

from __future__ import annotations

from typing import ClassVar

from nvsdata.datasets.facts import Archive, ExpectedCount, Info
from nvsdata.datasets.families import BottomOriginDataset, RandomSplitDataset


class ASLDVS(BottomOriginDataset, RandomSplitDataset):
    """ASL-DVS (Bi et al. 2019): 24 letters of American Sign Language, a DAVIS240C, 240x180.

    100,800 recordings of about 100 ms and 28,000 events, `<letter>/<letter>_<id>.mat`, letters a to y
    without j. The files count y from the bottom of the sensor; here it counts from the top.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all"; a random fifth of each class is for testing.
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        fold: seed of the random split, at least 0 (default 0).
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Example:
        >>> import nvsdata
        >>> train = nvsdata.ASLDVS("data/asl-dvs", "train")  # doctest: +SKIP
        >>> nvsdata.ASLDVS.info.sensor_size, len(nvsdata.ASLDVS.info.classes)
        ((240, 180), 24)
    """

    info = Info(
        name="asl-dvs",
        sensor_size=(240, 180),
        classes=tuple("abcdefghiklmnopqrstuvwxy"),
        page="https://www.dropbox.com/sh/ibq0jsicatn7l6r/AACNrNELV56rs1YInMWUs9CAa",
        license="not stated",
        # the server makes a new zip for each download, so its hash differs each time
        archives=(Archive("ICCV2019_DVS_dataset.zip", "", (), "ICCV2019_DVS_dataset", 5807293496),),
        recordings=100_800,
        expected_counts=tuple(ExpectedCount(letter, 4_200) for letter in "abcdefghiklmnopqrstuvwxy"),
        known_from="the authors",
        tree="<letter>/<letter>_<id>.mat",
    )
    aliases: ClassVar[dict[str, str]] = {f"Yin Bi - {letter}": letter for letter in "abcdefghiklmnopqrstuvwxy"}
