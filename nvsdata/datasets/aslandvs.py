"""The ASLAN-DVS dataset."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import scipy.io

from nvsdata.data.recording import Recording
from nvsdata.datasets.facts import Archive, Info
from nvsdata.datasets.families import BottomOriginDataset, numbered_fold
from nvsdata.datasets.source import path_below, recordings_in

CSV, VIEW2, VARIABLE = "aslan_pairs.csv", "View2.mat", "action_splits_pairs"


class RecordingPair(NamedTuple):
    """Paths of two recordings below the root; `label` is 1 if they show the same action, otherwise 0."""

    a: str
    b: str
    label: int


class ASLANDVS(BottomOriginDataset):
    """ASLAN-DVS (Bi et al. 2020): pairs of recordings of the same or of different actions, DAVIS240C, 240x180.

    `dataset[i]` is `((a, b), same)`: two recordings, each given to the transform, and 1 or 0. The pairs are those of
    ASLAN's View 2: ten subsets, each of 300 pairs of the same action and 300 of different actions. They are read from
    `View2.mat` (its variable `action_splits_pairs`, [600, 5, 10], columns: two ids, same, two actions) or from
    `aslan_pairs.csv` (columns fold, video_a, video_b, same) below `root`. A video is identified by its recording's
    name, or by the number at the end of that name. Pairs with a missing recording are left out; `missing` lists the
    missing videos.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train", "test" or "all".
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        fold: 1 to 10 (default 1), the subset for testing; the others are for training.
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Raises:
        FileNotFoundError: neither file of pairs is below `root`, or `root` has no recordings.
        ValueError: the file of pairs has another layout.

    Example:
        >>> import nvsdata
        >>> train = nvsdata.ASLANDVS("data/aslan-dvs", "train")  # doctest: +SKIP
        >>> nvsdata.ASLANDVS.info.sensor_size, len(nvsdata.ASLANDVS.info.classes)
        ((240, 180), 2)
    """

    info = Info(
        name="aslan-dvs",
        sensor_size=(240, 180),
        classes=("different", "same"),
        page="https://www.dropbox.com/sh/ie75dn246cacf6n",
        license="not stated",
        archives=(
            Archive(
                "Yin Bi - ASLAN-DVS-Part1.zip",
                "2d78143d650b702c11239a89fd696764f8a65bbcd8cb2b17a2f3d95954177aa2",
                (),
                "Part1",
                2775740870,
            ),
            Archive(
                "Yin Bi - ASLAN-DVS-Part2.zip",
                "52e7224100f02b59991dd340b84470b5cc5bfc63330435e87bc54019bffbc1de",
                (),
                "Part2",
                2810654630,
            ),
        ),
        recordings=3_697,
        known_from="ASLAN's samples; one paper counts 3,631 recordings",
        tree="<recording whose name ends in the id>.mat, and View2.mat or aslan_pairs.csv",
    )

    def _check_fold(self, fold: int | None) -> int:
        return numbered_fold(fold, range(1, 11), 1)

    def found(self) -> list[Any]:
        """Return the pairs of all folds for which both recordings exist."""
        names = self._by_name()
        found = []
        self.folds: list[int] = []
        missing = set()
        for fold, a, b, same in self._pairs():
            missing |= {video for video in (a, b) if video not in names}
            if a in names and b in names:
                found.append(RecordingPair(names[a], names[b], same))
                self.folds.append(fold)
        self.missing = sorted(missing)
        return found

    def _select(self, found: Sequence[Any]) -> Iterator[Any]:
        for pair, fold in zip(found, self.folds, strict=True):
            if self.split_name == "all" or (fold == self.fold) == (self.split_name == "test"):
                yield pair

    def _by_name(self) -> dict[str, str]:
        """Return the recordings by file name without extension, and by the number at its end."""
        names = {}
        for where in recordings_in(self.listing):
            file = where.rsplit("/", 1)[-1]
            if file not in (CSV, VIEW2) and where not in self.source.left_out:
                stem = file.rsplit(".", 1)[0]
                names[stem] = where
                if number := re.search(r"(\d+)$", stem):
                    names.setdefault(str(int(number[1])), where)
        return names

    def _pairs(self) -> Iterator[tuple[int, str, str, int]]:
        listed = self._side_file(CSV)
        if listed is not None:
            try:
                for row in csv.DictReader(io.StringIO(listed)):
                    yield int(row["fold"]), row["video_a"].strip(), row["video_b"].strip(), int(row["same"])
            # a row that is too short has None at its end
            except (AttributeError, KeyError, TypeError, ValueError) as error:
                reason = f"{CSV} must have the columns fold, video_a, video_b and same: {error!r}"
                raise ValueError(reason) from None
            return
        folder = next((folder for folder, names in self.listing.items() if VIEW2 in names), None)
        if folder is None:
            raise FileNotFoundError(f"neither {VIEW2} nor {CSV} below {self.root}; ASLAN's page has View 2")
        pairs = scipy.io.loadmat(io.BytesIO(self.source.data(path_below(folder, VIEW2)))).get(VARIABLE)
        if pairs is None or pairs.ndim != 3 or pairs.shape[1] < 3:
            raise ValueError(f"{VIEW2} contains no {VARIABLE} of [pairs, 5, folds]")
        for fold in range(pairs.shape[2]):
            for a, b, same in pairs[:, :3, fold].astype(int).tolist():
                yield fold + 1, str(a), str(b), same

    def recording_names(self) -> list[str]:
        return sorted(set(self._by_name().values()))

    def total(self) -> tuple[int, int, str]:
        return len(self.recording_names()), self.info.recordings, "recordings"

    @property
    def packed_split(self) -> str:
        return "all"  # pairs of all splits consist of the same recordings

    def recordings(self, index: int) -> tuple[Recording, ...]:
        """Return the two recordings of a pair, opened but not decoded."""
        pair: Any = self.samples[index]
        return self.open_recording(pair.a), self.open_recording(pair.b)

    def combine(self, parts: Sequence[Any]) -> Any:
        return tuple(parts)

    def _files(self, sample: Any) -> tuple[str, ...]:
        return sample.a, sample.b

    @classmethod
    def _name_of(cls, sample: Any) -> str:
        return f"{_stem(sample.a)} {_stem(sample.b)}"


def _stem(name: str) -> str:
    return name.rsplit("/", 1)[-1].rsplit(".", 1)[0]
