"""The YUPENN-DVS dataset."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import ClassVar

from nvsdata.datasets.facts import ExpectedCount, Info, Sample
from nvsdata.datasets.families import BottomOriginDataset

CLASSES = (
    "beach",
    "elevator",
    "forest_fire",
    "fountain",
    "highway",
    "lightning_storm",
    "ocean",
    "railway",
    "rushing_river",
    "sky_clouds",
    "snowing",
    "street",
    "waterfall",
    "windmill_farm",
)


class YUPENNDVS(BottomOriginDataset):
    """YUPENN-DVS (Bi et al. 2020): dynamic scenes on a monitor in front of a DAVIS240C, 240x180.

    14 scenes with 30 recordings each. The layout of the files is not documented anywhere: class folders of
    recordings in any known format are read, their names compared without case, spaces and punctuation. The .mat
    files are assumed to count y from the bottom of the sensor, as in the authors' other datasets; here it counts
    from the top.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all"; a single recording is for testing.
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        fold: index of the recording for testing among all recordings (default 0).
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Raises:
        FileNotFoundError: `root` has no recordings.
        ValueError: `fold` isn't below the number of recordings.

    Example:
        >>> import nvsdata
        >>> train = nvsdata.YUPENNDVS("data/yupenn-dvs", "train")  # doctest: +SKIP
        >>> nvsdata.YUPENNDVS.info.sensor_size, len(nvsdata.YUPENNDVS.info.classes)
        ((240, 180), 14)
    """

    info = Info(
        name="yupenn-dvs",
        sensor_size=(240, 180),
        classes=CLASSES,
        page="https://github.com/PIX2NVS/NVS_FeatureLearning",
        license="not stated",
        recordings=420,
        expected_counts=tuple(ExpectedCount(name, 30) for name in CLASSES),
        known_from="the set of videos; no source describes the recordings",
    )
    aliases: ClassVar[dict[str, str]] = {"city street": "street", "sky-clouds": "sky_clouds"}

    def _check_fold(self, fold: int | None) -> int:
        if fold is not None and fold < 0:
            raise ValueError(f"fold, the index of the recording for testing, must be at least 0, not {fold}")
        return fold or 0

    def _select(self, found: Sequence[Sample]) -> Iterable[Sample]:
        if self.split_name in ("all", self.source.split) or not found:
            return found
        if self.fold >= len(found):
            raise ValueError(f"fold must be below the number of recordings, {len(found)}, not {self.fold}")
        left_out = found[self.fold]
        return self._held_out(found, lambda sample: sample == left_out)
