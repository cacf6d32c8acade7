"""The HMDB51-DVS dataset."""

from __future__ import annotations

import gzip
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import ClassVar

from nvsdata.datasets.facts import Archive, Info, Sample
from nvsdata.datasets.families import BottomOriginDataset, google_drive, numbered_fold

CLASSES = """
    brush_hair cartwheel catch chew clap climb climb_stairs dive draw_sword dribble drink eat fall_floor fencing
    flic_flac golf handstand hit hug jump kick kick_ball kiss laugh pick pour pullup punch push pushup ride_bike
    ride_horse run shake_hands shoot_ball shoot_bow shoot_gun sit situp smile smoke somersault stand swing_baseball
    sword sword_exercise talk throw turn walk wave
""".split()
SHIPPED = Path(__file__).with_name("lists") / "hmdb51.txt.gz"
PARTS = {"train": "1", "test": "2"}


@cache
def official() -> dict[str, dict[str, str]]:
    """Return HMDB51's three splits: class to video to a digit per split, as "120" (1 train, 2 test, 0 neither)."""
    found: dict[str, dict[str, str]] = {}
    for line in gzip.decompress(SHIPPED.read_bytes()).decode().splitlines():
        if line.endswith(":"):
            videos = found.setdefault(line[:-1], {})
        else:
            parts, _, stem = line.partition(" ")
            videos[stem] = parts
    return found


class HMDB51DVS(BottomOriginDataset):
    """HMDB51-DVS (Bi et al. 2020): HMDB51's videos on a monitor in front of a DAVIS240C, 240x180.

    About 6,766 recordings, `<class>/<video name>.mat` or `.aedat`, 51 classes. The splits are those of HMDB51, with 70
    videos per class for training and 30 for testing. They are read from `<class>_test_split<k>.txt` if such files are
    below `root`, otherwise from the lists that nvsdata contains. Recordings below 1 KB are empty; `skipped` lists them.
    The .mat files count y from the bottom of the sensor; here it counts from the top.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all".
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        fold: 1, 2 or 3 (default 1), the number of the split.
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Example:
        >>> import nvsdata
        >>> train = nvsdata.HMDB51DVS("data/hmdb51-dvs", "train")  # doctest: +SKIP
        >>> nvsdata.HMDB51DVS.info.sensor_size, len(nvsdata.HMDB51DVS.info.classes)
        ((240, 180), 51)
    """

    info = Info(
        name="hmdb51-dvs",
        sensor_size=(240, 180),
        classes=tuple(CLASSES),
        page="https://github.com/PIX2NVS/NVS_FeatureLearning",
        license="not stated",
        archives=(Archive("HMDB-DVS.zip", "", (google_drive("1TVHsmv-Pt2jZVcxfPgpGonXDzqbAAGDB"),), "HMDB51_DVS"),),
        recordings=6_766,
        known_from="the paper; one of the releases has 6,765",
        tree="<class>/<video>.mat or .aedat",
    )
    aliases: ClassVar[dict[str, str]] = {"clibmstairs": "climb_stairs"}
    smallest: ClassVar[int] = 1024

    def _check_fold(self, fold: int | None) -> int:
        return numbered_fold(fold, range(1, 4), 1)

    def _select(self, found: Sequence[Sample]) -> Iterable[Sample]:
        if self.split_name == "all":
            return found
        wanted = PARTS[self.split_name]
        lists = self._lists()
        chosen = {
            (label, stem)
            for label, name in enumerate(self.classes)
            for stem, part in lists.get(name, {}).items()
            if part == wanted
        }
        return [sample for sample in found if (sample.label, sample.stem) in chosen]

    def _lists(self) -> dict[str, dict[str, str]]:
        """Return the split of each video, by class: from lists below the root if there are any, else from nvsdata's."""
        own = {name: dict(self._listed_in(f"{name}_test_split{self.fold}.txt")) for name in self.classes}
        if any(own.values()):
            return own
        return {name: {stem: parts[self.fold - 1] for stem, parts in of.items()} for name, of in official().items()}

    def split_lists(self) -> dict[str, list[str]]:
        names = [f"{name}_test_split{self.fold}.txt" for name in self.classes]
        found = {name: [stem for stem, _ in self._listed_in(name)] for name in names}
        return {name: stems for name, stems in found.items() if stems}

    def _listed_in(self, name: str) -> Iterator[tuple[str, str]]:
        """Yield the name, without extension, and the part ("1" is train, "2" is test) of each video in a list."""
        for line in (self._side_file(name) or "").splitlines():
            video, _, part = line.strip().rpartition(" ")
            yield video.strip().rsplit(".", 1)[0], part
