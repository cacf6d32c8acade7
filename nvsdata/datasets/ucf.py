"""The UCF101-DVS and UCF50-DVS datasets."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import ClassVar

from nvsdata.datasets.facts import Archive, ExpectedCount, Info, Sample
from nvsdata.datasets.families import BottomOriginDataset, google_drive, numbered_fold

UCF101_CLASSES = """
    ApplyEyeMakeup ApplyLipstick Archery BabyCrawling BalanceBeam BandMarching BaseballPitch Basketball
    BasketballDunk BenchPress Biking Billiards BlowDryHair BlowingCandles BodyWeightSquats Bowling BoxingPunchingBag
    BoxingSpeedBag BreastStroke BrushingTeeth CleanAndJerk CliffDiving CricketBowling CricketShot CuttingInKitchen
    Diving Drumming Fencing FieldHockeyPenalty FloorGymnastics FrisbeeCatch FrontCrawl GolfSwing Haircut HammerThrow
    Hammering HandstandPushups HandstandWalking HeadMassage HighJump HorseRace HorseRiding HulaHoop IceDancing
    JavelinThrow JugglingBalls JumpRope JumpingJack Kayaking Knitting LongJump Lunges MilitaryParade Mixing
    MoppingFloor Nunchucks ParallelBars PizzaTossing PlayingCello PlayingDaf PlayingDhol PlayingFlute PlayingGuitar
    PlayingPiano PlayingSitar PlayingTabla PlayingViolin PoleVault PommelHorse PullUps Punch PushUps Rafting
    RockClimbingIndoor RopeClimbing Rowing SalsaSpin ShavingBeard Shotput SkateBoarding Skiing Skijet SkyDiving
    SoccerJuggling SoccerPenalty StillRings SumoWrestling Surfing Swing TableTennisShot TaiChi TennisSwing
    ThrowDiscus TrampolineJumping Typing UnevenBars VolleyballSpiking WalkingWithDog WallPushups WritingOnBoard YoYo
""".split()

UCF50_CLASSES = """
    BaseballPitch Basketball BenchPress Biking Billiards BreastStroke CleanAndJerk Diving Drumming Fencing GolfSwing
    HighJump HorseRace HorseRiding HulaHoop JavelinThrow JugglingBalls JumpRope JumpingJack Kayaking Lunges
    MilitaryParade Mixing Nunchucks PizzaTossing PlayingGuitar PlayingPiano PlayingTabla PlayingViolin PoleVault
    PommelHorse PullUps Punch PushUps RockClimbingIndoor RopeClimbing Rowing SalsaSpin SkateBoarding Skiing Skijet
    SoccerJuggling Swing TaiChi TennisSwing ThrowDiscus TrampolineJumping VolleyballSpiking WalkingWithDog YoYo
""".split()
# number of videos per class of UCF50
UCF50_COUNTS = [
    int(count)
    for count in """
    150 137 160 145 150 101 112 153 161 111 142 123 127 197 125 117 122 148 123 157 141 127 141 150 114 160 105
    124 100 160 123 120 160 106 148 130 137 133 120 144 100 156 137 100 167 131 119 116 123 128
    """.split()
]


class _UCF(BottomOriginDataset):
    """Recordings `<Class>/v_<Class>_g<NN>_c<MM>.<suffix>`; the clips of a group gNN were cut from one video."""

    smallest: ClassVar[int] = 1024

    @cached_property
    def groups(self) -> list[int]:
        """Group of each sample."""
        return [group_of(sample) for sample in self.samples]


class UCF101DVS(_UCF):
    """UCF101-DVS (Bi et al. 2020): UCF101's videos on a monitor in front of a DAVIS240C, 240x180.

    About 13,500 recordings, `<Class>/v_<Class>_g<NN>_c<MM>.mat`. The splits are those of UCF101, read from
    `trainlist0<k>.txt` and `testlist0<k>.txt` if they are below `root`. Otherwise the rule of these lists is applied:
    groups 7k - 6 to 7k are for testing.
    Recordings below 1 KB are empty; `skipped` lists them. `groups` has the group of each sample.
    The .mat files are assumed to count y from the bottom of the sensor, as in ASL-DVS, though public programs that read
    the dataset disagree on this; here y counts from the top.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all".
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        fold: 1, 2 or 3 (default 1), the number k of the split.
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Example:
        >>> import nvsdata
        >>> train = nvsdata.UCF101DVS("data/ucf101-dvs", "train")  # doctest: +SKIP
        >>> nvsdata.UCF101DVS.info.sensor_size, len(nvsdata.UCF101DVS.info.classes)
        ((240, 180), 101)
    """

    info = Info(
        name="ucf101-dvs",
        sensor_size=(240, 180),
        classes=tuple(UCF101_CLASSES),
        page="https://github.com/PIX2NVS/NVS_FeatureLearning",
        reported_size="28 GB (reported)",
        license="not stated",
        archives=(Archive("UCF101-DVS.zip", "", (google_drive("1icJFUNJZEofOke-9bizfD-m4643G1ycg"),), "UCF101_DVS"),),
        recordings=13_523,
        known_from="two public programs that read it; the paper has UCF101's 13,320; no source explains the difference",
        tree="<Class>/v_<Class>_g<NN>_c<MM>.mat, and perhaps trainlist01.txt and so on",
    )
    aliases: ClassVar[dict[str, str]] = {"Billards": "Billiards"}

    def _check_fold(self, fold: int | None) -> int:
        return numbered_fold(fold, range(1, 4), 1)

    def _select(self, found: Sequence[Sample]) -> Iterable[Sample]:
        if self.split_name == "all":
            return found
        stems = self._stems_in(f"{self.split_name}list0{self.fold}.txt")
        if stems is None:
            # the rule of UCF101's lists: each split has the next seven groups for testing
            held = range(7 * self.fold - 6, 7 * self.fold + 1)
            return self._held_out(found, lambda sample: group_of(sample) in held)
        return [sample for sample in found if sample.stem.lower() in stems]

    def split_lists(self) -> dict[str, list[str]]:
        names = (f"{part}list0{fold}.txt" for fold in (1, 2, 3) for part in ("train", "test"))
        return {name: list(stems) for name in names if (stems := self._stems_in(name))}

    def _stems_in(self, name: str) -> dict[str, None] | None:
        """Return the names in the list `name`, in lower case because case varies; None if there is no such list."""
        listed = self._side_file(name)
        if listed is None:
            return None
        lines = [line.split()[0] for line in listed.splitlines() if line.strip()]
        return {line.rsplit("/", 1)[-1].rsplit(".", 1)[0].lower(): None for line in lines}


class UCF50DVS(_UCF):
    """UCF50-DVS (Hu et al. 2016): UCF50's videos on a monitor in front of a DAVIS240C, 240x180, AEDAT 2.

    6,681 recordings, `<Class>/v_<Class>_g<NN>_c<MM>.aedat`. If a file's name spells the class differently from its
    folder, the folder decides. `groups` has the group of each sample.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all".
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        fold: 1 to 25 (default 1), the group that is for testing.
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Example:
        >>> import nvsdata
        >>> train = nvsdata.UCF50DVS("data/ucf50-dvs", "train")  # doctest: +SKIP
        >>> nvsdata.UCF50DVS.info.sensor_size, len(nvsdata.UCF50DVS.info.classes)
        ((240, 180), 50)
    """

    info = Info(
        name="ucf50-dvs",
        sensor_size=(240, 180),
        classes=tuple(UCF50_CLASSES),
        page="http://dgyblog.com/projects-term/dvs-dataset.html",
        license="not stated",
        archives=(Archive("UCF50-DVS.zip", "", (), "UCF50_DVS"),),
        recordings=6_681,
        expected_counts=tuple(
            ExpectedCount(name, count) for name, count in zip(UCF50_CLASSES, UCF50_COUNTS, strict=True)
        ),
        known_from="the authors' statistics, which are those of UCF50's videos; another source counts 6,676",
        tree="<Class>/v_<Class>_g<NN>_c<MM>.aedat",
    )

    def _check_fold(self, fold: int | None) -> int:
        return numbered_fold(fold, range(1, 26), 1)

    def _select(self, found: Sequence[Sample]) -> Iterable[Sample]:
        return self._held_out(found, lambda sample: group_of(sample) == self.fold)


def group_of(sample: Sample) -> int:
    """Return the number of the group gNN in a file's name; 0 if there is none."""
    match = re.search(r"_g(\d+)_c\d+$", sample.stem)
    return int(match[1]) if match else 0
