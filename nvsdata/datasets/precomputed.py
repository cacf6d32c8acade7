"""Datasets of precomputed samples."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn

from nvsdata.common.errors import shown
from nvsdata.datasets.facts import Sample
from nvsdata.datasets.indexing import PairTransform, Samples, Transform
from nvsdata.datasets.registry import DATASETS
from nvsdata.datasets.store.index import PART
from nvsdata.datasets.store.opening import open_store, refuse_shard
from nvsdata.datasets.store.reader import Store
from nvsdata.remote.url import place_of


class Precomputed(Samples):
    """Samples that `precompute` wrote into a file, with their targets.

    It has the samples of the dataset in the same order, except those that were left out, and the same `split` and
    `hold_out`. Each sample's checksum is verified when it is read.

    Args:
        root: path or URL of the file, or of the index file of joined shards.
        transform: applied to the sample: the rest of the pipeline, such as augmentation.
        target_transform: applied to the target, an int.
        transforms: a function of sample and target that returns both, in place of the two.
        seed: makes random transforms depend on (seed, epoch, index) alone; see `Samples`.
        errors: "raise", or "skip": the next sample takes the place of a damaged one; see `Samples`.

    Attributes:
        classes: names of the classes, in the order of their labels.
        class_to_idx: name of a class to its label.
        head: repr of the transforms that were applied before the samples were stored.
        samples: one `Sample` for each sample.
        targets: label of each sample, ints.
        skipped: names of samples that were left out.

    Raises:
        FileNotFoundError: there is no such file, or it has no samples.
        FormatError: the file is damaged.
        ValueError: the file has recordings, or is a single shard.

    Example:
        >>> import tempfile, nvsdata
        >>> from pathlib import Path
        >>> from nvsdata import transforms as T
        >>> root = Path(tempfile.mkdtemp())
        >>> (root / "data/waving").mkdir(parents=True)
        >>> _ = nvsdata.write(nvsdata.example(), root / "data/waving/0.npy")
        >>> dataset = nvsdata.EventFolder(root / "data", transform=T.Compose([T.Window(0, 20_000), T.RadiusGraph()]))
        >>> _ = nvsdata.precompute(dataset, root / "graphs.nvs")
        >>> graphs = nvsdata.Precomputed(root / "graphs.nvs", transform=T.RandomFlip(p=1))
        >>> len(graphs), graphs[0][1]
        (1, 0)
    """

    source: Store

    def __init__(
        self,
        root: str | os.PathLike[str],
        transform: Transform | None = None,
        target_transform: Transform | None = None,
        *,
        transforms: PairTransform | None = None,
        seed: int | None = None,
        errors: str = "raise",
    ) -> None:
        self.root = place_of(root)
        self._set(transform, target_transform, transforms, seed, errors)
        if isinstance(self.root, Path) and not self.root.is_file():
            raise FileNotFoundError(f"{self.root} is not a file: `nvsdata precompute` makes one")
        store = self.source = open_store(self.root)
        if store.precomputed is None:
            raise ValueError(f"{self.root} has recordings, not precomputed samples: open it with the dataset's class")
        refuse_shard(store, self.root)
        self.classes, self.head = store.precomputed.classes, store.precomputed.transform
        self.class_to_idx = {name: index for index, name in enumerate(self.classes)}
        self.skipped = list(store.left_out)
        # shards have every n-th sample
        order = sorted(zip(store.samples, store.names, strict=True), key=lambda one: one[0][2])
        self.samples = [_sample(name, part, label) for (part, label, _), name in order]
        if not self.samples:
            raise FileNotFoundError(f"{self.root} has no samples")
        self._count()

    @property
    def in_scenes(self) -> bool:  # type: ignore[override]
        """True if neighboring files often show the same scene."""
        return self.source.dataset in DATASETS and DATASETS[self.source.dataset].in_scenes

    @cached_property
    def names(self) -> list[tuple[str, str]]:
        """Class and name of each sample, as of the dataset."""
        name_of = DATASETS.get(self.source.dataset, Samples)._name_of
        return [(self.classes[sample.label], name_of(sample)) for sample in self.samples]

    def recording(self, index: int) -> NoReturn:
        """Raise TypeError: the file has no recordings."""
        raise TypeError(f"{self.root} has precomputed samples, no recordings")

    def _reason(self, index: int, repaired: bool) -> str:
        fault = self.source.fault(self._record_of(self.samples[index]))
        return f"replaced: {fault}" if fault else "replaced, but it can be read now"

    def _record_of(self, sample: Any) -> str:
        return str(sample.name + sample.part)

    def stored(self, index: int) -> Any:
        """Return a sample as it is stored, before the transforms."""
        return self.source.sample(self._record_of(self.samples[index]))

    def hand_over(self, engine: str, out: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write the stored samples as a folder that WebDataset or LitData streams; their transforms aren't applied.

        A sample has the bytes that `nvsdata.datasets.decode_sample` restores: in WebDataset as `nvs`, with `cls` for
        the label; in LitData as a dict with `sample` and `label`. The folder appears when it is complete.

        Args:
            engine: "webdataset" (`nvsdata[webdataset]`) or "litdata" (`nvsdata[litdata]`).
            out: the folder.
            overwrite: whether to replace an existing folder.

        Raises:
            FileExistsError: `out` exists, unless `overwrite`.
            ImportError: the engine isn't installed.
            ValueError: `engine` is unknown.

        Example:
            >>> nvsdata.Precomputed("graphs.nvs").hand_over("webdataset", "graphs")  # doctest: +SKIP
        """
        from nvsdata.datasets.store.engines import hand_over

        hand_over(self, engine, out, overwrite=overwrite)

    def _made(self, index: int) -> tuple[Any, Any]:
        sample, target = self.stored(index), self.target(index)
        if self.transforms is not None:
            return self.transforms(sample, target)
        return sample if self.transform is None else self.transform(sample), target

    def __repr__(self) -> str:
        lines = [
            f"Precomputed({shown(self.root)}): {len(self):,} samples of {self.source.dataset}, {self.source.split}",
            f"made by: {shown(self.head)}",
            f"transform: {self.transforms or self.transform!r}",
            *([f"left out: {len(self.skipped)}"] if self.skipped else []),
        ]
        return "\n    ".join(lines)


def _sample(name: str, part: str, label: int) -> Sample:
    """Return a sample by its name with its part, as `Sample.part` writes it."""
    found = PART.fullmatch(part)
    numbers = [None if text is None else int(text) for text in found.groups()] if found else [None] * 4
    window, events = (None if pair[0] is None else tuple(pair) for pair in (numbers[:2], numbers[2:]))
    return Sample(name.removesuffix(part), label, window, events)  # type: ignore[arg-type]
