"""What is known of a dataset and of its samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from nvsdata.datasets.holdings import Holding


class Sample(NamedTuple):
    """A recording: its path below the root, the index of its class, and its slice in time (µs) if it is one."""

    name: str
    label: int
    window: tuple[int, int] | None = None

    @property
    def file(self) -> str:
        """The file's name."""
        return self.name.rsplit("/", 1)[-1]

    @property
    def stem(self) -> str:
        """The file's name without its extension."""
        return self.file.rsplit(".", 1)[0]


@dataclass(frozen=True)
class Archive:
    """A file to download: `urls` are tried in order, `folder` is what it unpacks to.

    Without `urls` it needs a browser, or comes from the archive that it is `within`, which is downloaded if none of
    the `urls` gives it. `hash` is an md5 or a sha256, empty if none is known, as `size` in bytes is 0 then. The
    dataset is of use without what is `optional`.
    """

    name: str
    hash: str
    urls: tuple[str, ...]
    folder: str
    size: int = 0
    within: Archive | None = None
    optional: bool = False


@dataclass(frozen=True)
class Info:
    """Facts about a dataset.

    `recordings` is how many there are, `holds` how many of each class where that is known, `known_from` who says so
    and who says otherwise. `tree` is what lies below the root as it is distributed.
    """

    name: str
    sensor_size: tuple[int, int] | None
    classes: tuple[str, ...]
    page: str
    license: str
    archives: tuple[Archive, ...] = ()
    recordings: int = 0
    holds: tuple[Holding, ...] = ()
    known_from: str = ""
    tree: str = "<class>/<recording>"

    @property
    def by_program(self) -> bool:
        """Whether a program can download it."""
        return any(archive.urls for archive in self.archives)
