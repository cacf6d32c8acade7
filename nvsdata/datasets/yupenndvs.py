"""YUPENN-DVS."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

from nvsdata.datasets.facts import Holding, Info, Sample
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

    - `split`: "train" (default), "test" or "all"; a single recording is for testing
    - `fold`: index of that recording among all (default 0)
    - other parameters: those of `EventDataset`

    ValueError if `fold` isn't below the number of recordings.
    """

    info = Info(
        name="yupenn-dvs",
        sensor_size=(240, 180),
        classes=CLASSES,
        page="https://github.com/PIX2NVS/NVS_FeatureLearning",
        license="not stated",
        recordings=420,
        holds=tuple(Holding(name, 30) for name in CLASSES),
        known_from="the set of videos; no source describes the recordings",
    )
    aliases: ClassVar[dict[str, str]] = {"city street": "street", "sky-clouds": "sky_clouds"}

    def _check_fold(self, fold: int | None) -> int:
        if fold is not None and fold < 0:
            raise ValueError(f"fold is the index of the recording to leave out: at least 0, not {fold}")
        return fold or 0

    def _select(self, found: list[Sample]) -> Iterable[Sample]:
        if self.split_name in ("all", self.source.split) or not found:
            return found
        if self.fold >= len(found):
            raise ValueError(f"fold must be below the {len(found)} recordings, not {self.fold}")
        left_out = found[self.fold]
        return self._held_out(found, lambda sample: sample is left_out)
