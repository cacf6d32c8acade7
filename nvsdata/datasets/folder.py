"""Folders of the user's own recordings."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cache, cached_property

from nvsdata import formats
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.facts import Info, Sample
from nvsdata.datasets.indexing import PairTransform, Transform
from nvsdata.datasets.sample_list import SampleList
from nvsdata.datasets.source import Folder, recordings_in
from nvsdata.formats.registry import lacking_packages

PARTS = ("train", "test")


@cache
def _check_readable(path: str) -> None:
    """Raise ImportError if a recording needs a package that isn't installed. A process opens it once."""
    # damage is reported when the sample is taken
    with suppress(OSError, ValueError):
        formats.open(path).read(0, 1)


class EventFolder(EventDataset):
    """A folder of class folders with recordings in any known format, like torchvision's ImageFolder.

    The classes are the sorted folder names, the same for all splits.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one.
        split: "train" and "test" take the class folders in `root/train` and `root/test`, in upper or lower case. "all"
            (default) takes the class folders in `root` itself or, if all recordings are below `root/train` and
            `root/test`, the class folders in both.
        transform: applied to the undecoded `Recording`; without one, a sample is the recording's `Events`.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        sensor_size: (width, height) in pixels of every recording; None takes the size that each recording states. The
            dataset's `sensor_size` is then that of its first recording.
        fold: must be None: there is one split.
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part).

    Raises:
        FileNotFoundError: there is no such folder, no class folder in it, or no recording.
        ImportError: recordings need a package that isn't installed.
        ValueError: recordings are both in train or test folders and in other folders, for "all".

    Example:
        >>> import tempfile, nvsdata
        >>> from pathlib import Path
        >>> root = Path(tempfile.mkdtemp())
        >>> (root / "waving").mkdir()
        >>> _ = nvsdata.write(nvsdata.example(), root / "waving/0.npy")
        >>> nvsdata.EventFolder(root).classes
        ['waving']
    """

    info = Info(
        name="folder",
        sensor_size=None,
        classes=(),
        page="your own files",
        license="your own",
        tree="<class>/<recording>, or train/<class>/<recording> and test/<class>/<recording>",
    )
    splits = ("all", *PARTS)

    def __init__(
        self,
        root: str | os.PathLike[str],
        split: str | None = None,
        transform: Transform | None = None,
        target_transform: Transform | None = None,
        download: bool = False,
        *,
        sensor_size: tuple[int, int] | None = None,
        fold: int | None = None,
        train: bool | None = None,
        transforms: PairTransform | None = None,
        seed: int | None = None,
        errors: str = "raise",
    ) -> None:
        self._size = sensor_size
        super().__init__(
            root,
            split,
            transform,
            target_transform,
            download,
            fold=fold,
            train=train,
            transforms=transforms,
            seed=seed,
            errors=errors,
        )
        self._check_packages()

    def _check_packages(self) -> None:
        """Raise ImportError if recordings need a package that isn't installed.

        The first and the last file of each folder are looked at, and a recording of each kind is opened.
        """
        # a store has events, whatever the recordings were
        if not isinstance(self.source, Folder) or not (lacking := lacking_packages()):
            return
        found: dict[str, str] = {}
        for folder, names in self.listing.items():
            for name in (*names[:1], *names[-1:]):
                found.setdefault(os.path.splitext(name)[1].lower(), os.path.join(self.source.root, folder, name))
        for suffix in sorted(found.keys() & lacking):
            _check_readable(found[suffix])

    @cached_property
    def _first_size(self) -> tuple[int, int]:
        """Sensor size of the first recording or, if `errors` isn't "raise", of the first that can be read."""
        if self._size is not None:
            return self._size
        if self._damage is None:
            return self.recording(0).sensor_size
        size: tuple[int, int] = self._damage.first_readable(0, lambda index: self.recording(index).sensor_size)
        return size

    @property
    def sensor_size(self) -> tuple[int, int] | None:
        return self._first_size

    @property
    def opened_with(self) -> tuple[int, int] | None:
        return self._size

    @property
    def packed_split(self) -> str:
        return "all"

    @cached_property
    def _parts(self) -> dict[str, str]:
        """The parts found: "train" and "test", mapped to the names of their folders."""
        top = {folder.split("/")[0] for folder in self.listing} - {"."}
        # a folder "train" that contains recordings itself is a class, such as railway trains
        classes = {name.split("/")[0] for name in recordings_in(self.listing) if name.count("/") == 1}
        return {name.lower(): name for name in sorted(top - classes) if name.lower() in PARTS}

    @cached_property
    def _homes(self) -> list[str]:
        """Folders that contain the split's class folders: paths below the root with a final slash, "" for the root."""
        if self.split_name != "all":
            if self.split_name not in self._parts:
                raise FileNotFoundError(
                    f"{self.root}{os.sep}{self.split_name} is not a folder; split={self.split_name!r} needs it"
                )
            return [self._parts[self.split_name] + "/"]
        if not self._parts:
            return [""]
        used = {name.split("/")[0] for name in recordings_in(self.listing) if "/" in name}
        if others := used - set(self._parts.values()):
            which = f"{' and '.join(self._parts.values())}, and class folders ({', '.join(sorted(others)[:3])})"
            raise ValueError(f"{self.root} has {which}: say split='train' or 'test', or give a folder that has either")
        return [name + "/" for name in self._parts.values()]

    def _classes(self) -> list[str]:
        # the classes of all parts, because a class missing in one part would shift the labels
        homes = {*self._homes, *(name + "/" for name in self._parts.values())} - {""} or {""}
        names = {
            folder[len(home) :].split("/")[0] for home in homes for folder in self.listing if folder.startswith(home)
        }
        if not names - {"", "."}:
            raise FileNotFoundError(self._nothing("no class folders with recordings"))
        return sorted(names - {"", "."})

    def found(self) -> Sequence[Sample]:
        return SampleList.sorted(self._recordings, self._label_of, by_file=False)

    def _label_of(self, folder: str) -> int | None:
        homes = [home for home in self._homes if folder.startswith(home)]
        return self.class_to_idx.get(folder[len(homes[0]) :].split("/")[0]) if homes else None

    def _select(self, found: Sequence[Sample]) -> Iterable[Sample]:
        return found

    def recording_names(self) -> list[str]:
        # the recordings of all splits, which a store contains
        return [name for name in recordings_in(self.listing) if "/" in name]

    def _how_to_get(self) -> str:
        return f"it needs class folders with recordings ({', '.join(formats.suffixes())})"
