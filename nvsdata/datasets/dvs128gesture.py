"""The DVS128 Gesture dataset."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property

from nvsdata.data.recording import Recording
from nvsdata.data.views import Scaled
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.facts import Archive, Info, Sample
from nvsdata.datasets.source import path_below

CLASSES = (
    "hand_clapping",
    "right_hand_wave",
    "left_hand_wave",
    "right_arm_clockwise",
    "right_arm_counter_clockwise",
    "left_arm_clockwise",
    "left_arm_counter_clockwise",
    "arm_roll",
    "air_drums",
    "air_guitar",
    "other_gestures",
)
FIRST_TEST_USER = 24
TRIAL = re.compile(r"user(\d+)_([a-z_]+)(?=[./])")  # name of a file, or of a folder in the preprocessed release
PREPROCESSED = re.compile(r"(\d+)\.npy")
PREPROCESSED_GESTURES = 1_341
MILLISECOND = 1_000  # µs: unit of times in the preprocessed release


class DVS128Gesture(EventDataset):
    """DVS128 Gesture (Amir et al. 2017): 11 gestures of 29 people in 5 lightings, a DVS128.

    122 trials, `user<NN>_<lighting>.aedat` with `user<NN>_<lighting>_labels.csv`. A sample is a labeled slice of a
    trial; only the packets of the slice are read. A label that ends after the next label begins (there is one in
    user22_led) is cut at that beginning.

    The preprocessed release (figshare files 38022171 and 38020584: 1,341 gestures,
    `user<NN>_<lighting>/<class>.npy`, times in whole ms) is read, too.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all", by `trials_to_train.txt` and `trials_to_test.txt`; if these are missing, users
            1 to 23 are for training.
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

    Attributes:
        users: number of the person in each sample.
        lightings: lighting of each sample.
        samples: `samples[i].window` is (start, end) of sample i in µs.

    Raises:
        FileNotFoundError: `root` has no recordings of the split.
        ValueError: a table of labels can't be read.

    Example:
        >>> import nvsdata
        >>> train = nvsdata.DVS128Gesture("data/dvs128-gesture", "train")  # doctest: +SKIP
        >>> nvsdata.DVS128Gesture.info.sensor_size, len(nvsdata.DVS128Gesture.info.classes)
        ((128, 128), 11)
    """

    info = Info(
        name="dvs128-gesture",
        sensor_size=(128, 128),
        classes=CLASSES,
        page="https://ibm.ent.box.com/s/3hiq58ww1pbbjrinh367ykfdf60xsfm8/folder/50167556794",
        reported_size="3 GB (reported)",
        license="CC BY 4.0",
        archives=(
            Archive(
                "DvsGesture.tar.gz",
                "8a5c71fb11e24e5ca5b11866ca6c00a1",
                ("https://www.dropbox.com/s/cct5kyilhtsliup/DvsGesture.tar.gz?dl=1",),
                "DvsGesture",
            ),
        ),
        recordings=1_464,
        known_from="the rows of the archive's 122 tables; the paper counts 1,342 gestures",
        tree="user<NN>_<lighting>.aedat with user<NN>_<lighting>_labels.csv, and trials_to_train.txt",
    )

    def found(self) -> list[Sample]:
        """Return one sample per labeled gesture, sorted by trial."""
        found: list[Sample] = []
        for folder, names in self.listing.items():
            for name in names:
                stem, _, suffix = name.rpartition(".")
                place = path_below(folder, name)
                if suffix.lower() in ("aedat", "aedat3", "h5") and f"{stem}_labels.csv" in names:
                    labels = self.source.data(path_below(folder, f"{stem}_labels.csv")).decode("utf-8-sig")
                    found += [Sample(place, label, window) for label, window in _gestures(place, labels)]
                elif (cut := PREPROCESSED.fullmatch(name)) and TRIAL.search(place) and int(cut[1]) < len(CLASSES):
                    found.append(Sample(place, int(cut[1])))
        return sorted(found, key=lambda sample: (_trial(sample)[0], sample.window or (), sample.label))

    def total(self) -> tuple[int, int, str]:
        found = self.found()
        cut = any(sample.window is None for sample in found)
        return len(found), PREPROCESSED_GESTURES if cut else self.info.recordings, "gestures"

    def split_lists(self) -> dict[str, list[str]]:
        names = (f"trials_to_{part}.txt" for part in ("train", "test"))
        return {name: listed for name in names if (listed := self._trials_in(name))}

    def _trials_in(self, name: str) -> list[str] | None:
        """Return the trials in the list `name`, without extension; None if there is no such list."""
        listed = self._side_file(name)
        if listed is None:
            return None
        return [line.strip().rsplit(".", 1)[0] for line in listed.splitlines() if line.strip()]

    def _select(self, found: Sequence[Sample]) -> Iterable[Sample]:
        trials = self._trials_in(f"trials_to_{self.split_name}.txt")
        if trials is not None:
            wanted = set(trials)
            return [sample for sample in found if _trial(sample)[0] in wanted]
        return self._held_out(found, lambda sample: int(_trial(sample)[1]) >= FIRST_TEST_USER)

    @classmethod
    def _name_of(cls, sample: Sample) -> str:
        return f"{_trial(sample)[0]} {super()._name_of(sample)}"

    def _view(self, recording: Recording) -> Recording:
        return Scaled(recording, MILLISECOND) if recording.format == "npy" else recording

    @cached_property
    def users(self) -> list[int]:
        """Number of the person in each sample."""
        return [int(_trial(sample)[1]) for sample in self.samples]

    @cached_property
    def lightings(self) -> list[str]:
        """Lighting of each sample."""
        return [_trial(sample)[2] for sample in self.samples]


def _trial(sample: Sample) -> re.Match[str]:
    """Return the match of a trial's name, with groups user number and lighting; ValueError for another name."""
    trial = TRIAL.search(sample.name)
    if trial is None:
        raise ValueError(f"{sample.name}: a trial's name is user<NN>_<lighting>")
    return trial


def _gestures(name: str, labels: str) -> Iterator[tuple[int, tuple[int, int]]]:
    """Yield label (from 0) and (start, end) in µs of each row; an end after the next row's start is set to that."""
    rows = list(csv.DictReader(io.StringIO(labels)))
    try:
        table = sorted((int(r["startTime_usec"]), int(r["endTime_usec"]), int(r["class"]) - 1) for r in rows)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{name}: labels aren't a table of class, startTime_usec, endTime_usec: {error!r}") from None
    for k, (start, end, label) in enumerate(table):
        end = min(end, table[k + 1][0]) if k + 1 < len(table) else end
        if not 0 <= label < len(CLASSES) or end < start:
            raise ValueError(f"{name}: a label of class {label + 1} from {start} to {end} µs is impossible")
        yield label, (start, end)
