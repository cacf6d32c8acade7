"""Dataset cards of stores, as the Hugging Face hub shows them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path

from nvsdata.common.errors import shown
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.registry import DATASETS
from nvsdata.datasets.store.reader import Store
from nvsdata.remote.url import Url

LICENSES = {"CC0": "cc0-1.0", "CC BY 4.0": "cc-by-4.0", "CC BY-SA 4.0": "cc-by-sa-4.0"}  # the hub's names
SIZES = ((0, "n<1K"), (1_000, "1K<n<10K"), (10_000, "10K<n<100K"), (100_000, "100K<n<1M"), (1_000_000, "1M<n<10M"))
TAGS = ("event-camera", "neuromorphic", "nvsdata")


def dataset_card(paths: Sequence[Path], folder: Url) -> str:
    """Return a dataset card in Markdown, with a head in YAML, for stores in a folder.

    It has facts that nvsdata knows of the dataset, and the number of recordings, size and splits of each store.

    Args:
        paths: the stores.
        folder: the folder that gets them.
    """
    texts, kinds, recordings = [], list[type[EventDataset]](), 0
    for path in paths:
        with closing(Store(path)) as store:
            kind = DATASETS.get(store.dataset)
            kinds += [kind] if kind is not None and kind not in kinds else []
            recordings += len(store.names)
            texts.append(_of_store(path, store, kind))
            if store.shard is None:
                texts.append(_usage(str(folder.child(path.name)), store, kind))
    names = [_cell(kind.info.name) for kind in kinds]
    title = ", ".join(names) or "Event recordings"
    parts = [_head(kinds, title, recordings), f"# {title}", *map(_of_dataset, kinds), *texts]
    return "\n\n".join(parts) + "\n"


def _head(kinds: list[type[EventDataset]], title: str, recordings: int) -> str:
    """Return the head in YAML, of which JSON is a part."""
    stated = {kind.info.license for kind in kinds}
    known = LICENSES.get(next(iter(stated))) if len(stated) == 1 else None
    lines = [f"pretty_name: {json.dumps(title)}"]
    # a license that was only reported isn't claimed
    lines += [f"license: {known}"] if known else ["license: other"]
    lines += [] if known else [f"license_name: {json.dumps('; '.join(sorted(stated)) or 'not stated')}"]
    lines += [f"size_categories: [{json.dumps([name for least, name in SIZES if recordings >= least][-1])}]"]
    lines += ["task_categories: [video-classification]", f"tags: [{', '.join(TAGS)}]"]
    return "\n".join(["---", *lines, "---"])


def _of_dataset(kind: type[EventDataset]) -> str:
    info = kind.info
    size = "{} x {} pixels".format(*info.sensor_size) if info.sensor_size else "as each recording states"
    lines = [f"Recordings of an event camera ({info.name}), packed by nvsdata.", ""]
    lines += [f"- Source: {info.page}"] if info.page else []
    lines += [f"- License: {info.license}", f"- Sensor: {size}"]
    lines += [f"- Classes: {len(info.classes)}"] if info.classes else []
    return "\n".join(lines)


def _of_store(path: Path, store: Store, kind: type[EventDataset] | None) -> str:
    """Return a table of a store's splits."""
    size = sum(store.extent(number)[1] - store.extent(number)[0] for number in range(len(store.names)))
    what = "recordings" if store.precomputed is None else "precomputed samples"
    facts = f"{len(store.names):,} {what}, {size / 1e6:,.1f} MB, {len(store.left_out):,} left out"
    lines = [f"## {_cell(path.name)}", "", facts]
    has_splits = store.shard is None and store.precomputed is None
    rows = _splits(path, store, kind) if kind is not None and has_splits else []
    if store.precomputed is not None:
        lines += ["", "Made by:", "", *(f"    {line}" for line in shown(store.precomputed.transform).splitlines())]
    if rows:
        lines += ["", "| split | samples | hash |", "|---|---|---|", *rows]
    return "\n".join(lines)


def _splits(path: Path, store: Store, kind: type[EventDataset]) -> list[str]:
    rows = []
    for split in kind.splits if store.split == "all" else (store.split,):
        with suppress(OSError, ValueError):
            found = kind(path, split, fold=store.fold or None)
            rows.append(f"| {_cell(split)} | {len(found):,} | {found.split_hash} |")
    return rows


def _usage(url: str, store: Store, kind: type[EventDataset] | None) -> str:
    """Return code that opens a store."""
    if store.precomputed is not None:
        call, found = f"Precomputed({json.dumps(url)})", "sample, label"
    else:
        name, split = kind.__name__ if kind else "EventFolder", json.dumps(shown(store.split))
        call, found = f"{name}({json.dumps(url)}, {split})", "events, label"
    return f"```python\nimport nvsdata\n\ndataset = nvsdata.{call}\n{found} = dataset[0]\n```"


def _cell(text: str) -> str:
    """Return a text that neither ends a cell of a table nor begins markup."""
    return "".join(f"\\{c}" if c in "\\`*_[]<>|#" else c for c in shown(text))
