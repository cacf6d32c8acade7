"""UCF101-DVS and UCF50-DVS."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cached_property
from typing import ClassVar

from nvsdata.datasets.base import Archive, Info, Sample, numbered_fold
from nvsdata.datasets.davis240 import Upright

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


class _UCF(Upright):
    """`<Class>/v_<Class>_g<NN>_c<MM>.<suffix>`: the group gNN is of clips cut from one video."""

    smallest: ClassVar[int] = 1024

    @cached_property
    def groups(self) -> list[int]:
        """Group of each sample."""
        return [group_of(sample) for sample in self.samples]


class UCF101DVS(_UCF):
    """UCF101-DVS (Bi et al. 2020): UCF101's videos on a monitor before a DAVIS240C, 240x180.

    About 13,500 recordings, `<Class>/v_<Class>_g<NN>_c<MM>.mat`. The splits are UCF101's own, `fold`
    1, 2 or 3 (default 1): `trainlist0<k>.txt` and `testlist0<k>.txt` if they lie below `root`, else the
    rule they follow, that groups 7k - 6 to 7k are for testing.
    Recordings below 1 KB are empty; `skipped` names them. `groups` has the group of each sample.
    y of the .mat files is taken to count from the bottom, as in ASL-DVS, and turned; public readers
    disagree on it.
    """

    info = Info(
        name="ucf101-dvs",
        sensor_size=(240, 180),
        classes=tuple(UCF101_CLASSES),
        page="https://github.com/PIX2NVS/NVS_FeatureLearning",
        licence="not stated",
        archives=(Archive("UCF101-DVS.zip", "", (), "UCF101_DVS"),),
        recordings=13_523,
    )
    aliases: ClassVar[dict[str, str]] = {"Billards": "Billiards"}

    def _check_fold(self, fold: int | None) -> int:
        return numbered_fold(fold, range(1, 4), 1)

    def _select(self, found: list[Sample]) -> Iterable[Sample]:
        if self.split == "all":
            return found
        name = f"{self.split}list0{self.fold}.txt"
        listed = self._side_file(name)
        if listed is None:
            # what the lists amount to: seven groups are for testing, the next seven in the next split
            held = range(7 * self.fold - 6, 7 * self.fold + 1)
            return self._held_out(found, lambda sample: group_of(sample) in held)
        lines = [line.split()[0] for line in listed.splitlines() if line.strip()]
        stems = {line.rsplit("/", 1)[-1].rsplit(".", 1)[0].lower() for line in lines}
        # file names are spelt in more ways than one
        return [sample for sample in found if sample.stem.lower() in stems]


class UCF50DVS(_UCF):
    """UCF50-DVS (Hu et al. 2016): UCF50's videos on a monitor before a DAVIS240C, 240x180, AEDAT 2.

    6,676 recordings, `<Class>/v_<Class>_g<NN>_c<MM>.aedat`. One group at a time is for testing: `fold`
    1 to 25 (default 1). The file names spell some classes differently from the folders, which count.
    """

    info = Info(
        name="ucf50-dvs",
        sensor_size=(240, 180),
        classes=tuple(UCF50_CLASSES),
        page="http://dgyblog.com/projects-term/dvs-dataset.html",
        licence="not stated",
        archives=(Archive("UCF50-DVS.zip", "", (), "UCF50_DVS"),),
        recordings=6_676,
    )

    def _check_fold(self, fold: int | None) -> int:
        return numbered_fold(fold, range(1, 26), 1)

    def _select(self, found: list[Sample]) -> Iterable[Sample]:
        return self._held_out(found, lambda sample: group_of(sample) == self.fold)


def group_of(sample: Sample) -> int:
    """The group gNN in a file's name; 0 if there is none."""
    match = re.search(r"_g(\d+)_c\d+$", sample.stem)
    return int(match[1]) if match else 0
