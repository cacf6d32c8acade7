"""Facts about a dataset and its samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Sample(NamedTuple):
    """A recording or a slice of one.

    Attributes:
        name: path below the root, with slashes.
        label: index of the class.
        window: (start, end) in µs of a slice; None for the entire recording.
        events: (number of events to skip at the beginning of the slice, number of events to take); None for all.
    """

    name: str
    label: int
    window: tuple[int, int] | None = None
    events: tuple[int, int] | None = None

    @property
    def file(self) -> str:
        """Name of the file."""
        return self.name.rsplit("/", 1)[-1]

    @property
    def stem(self) -> str:
        """Name of the file without its extension."""
        return self.file.rsplit(".", 1)[0]

    @property
    def part(self) -> str:
        """Suffix for the recording's name that identifies the slice; empty for the entire recording."""
        window = "" if self.window is None else " {}-{}".format(*self.window)
        return window if self.events is None else window + " {}+{}".format(*self.events)


@dataclass(frozen=True)
class Archive:
    """A file to download.

    Args:
        name: name of the file.
        hash: md5 or sha256; empty if unknown.
        urls: addresses, tried in order; empty if a browser is needed, or the file is part of another archive.
        folder: folder below the root into which it is unpacked.
        size: bytes; 0 if unknown.
        within: an archive that contains this one, downloaded if none of the `urls` works.
        optional: whether the dataset can be used without it.
    """

    name: str
    hash: str
    urls: tuple[str, ...]
    folder: str
    size: int = 0
    within: Archive | None = None
    optional: bool = False


@dataclass(frozen=True)
class ExpectedCount:
    """Number of recordings of a class in the dataset as distributed.

    Args:
        label: name of the class; "" for all classes together.
        count: number of recordings.
        part: part of the dataset, such as "train"; "" if there are no parts.
        stem: pattern of the recordings' names without extension, as "mnist_3_scale04_{:04d}"; "" if unknown.
        numbers: numbers that fill in the pattern.
    """

    label: str
    count: int
    part: str = ""
    stem: str = ""
    numbers: range = range(0)

    @property
    def stems(self) -> list[str]:
        """Names of the recordings without extension; empty if they aren't known."""
        return [self.stem.format(number) for number in self.numbers]


def expected_names(label: str, stem: str, numbers: range, part: str = "") -> ExpectedCount:
    """Return the expected count of a class whose recordings have the names `stem.format(number)`."""
    return ExpectedCount(label, len(numbers), part, stem, numbers)


@dataclass(frozen=True)
class Info:
    """Facts about a dataset.

    Args:
        name: name of the dataset in lower case, as commands and recipes take it.
        sensor_size: (width, height) in pixels of every recording; None if they differ.
        classes: names of the classes, in the order of their labels.
        page: address of the dataset's page.
        license: license, as stated or reported.
        archives: files to download.
        recordings: number of recordings; 0 if unknown.
        expected_counts: number of recordings of each class; empty if unknown.
        known_from: source of these counts, and sources that disagree.
        tree: layout below the root as distributed.
        reported_size: size of the download as reported elsewhere, if that of an archive is unknown.
    """

    name: str
    sensor_size: tuple[int, int] | None
    classes: tuple[str, ...]
    page: str
    license: str
    archives: tuple[Archive, ...] = ()
    recordings: int = 0
    expected_counts: tuple[ExpectedCount, ...] = ()
    known_from: str = ""
    tree: str = "<class>/<recording>"
    reported_size: str = ""

    @property
    def by_program(self) -> bool:
        """True if a program can download the dataset, without a browser."""
        return any(archive.urls for archive in self.archives)
