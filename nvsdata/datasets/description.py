"""Descriptions of datasets: shape of a sample, view in a notebook, error message if no recordings are found."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np
import torch

from nvsdata.common.errors import shown
from nvsdata.common.text import as_html, plain_name
from nvsdata.datasets.facts import Sample
from nvsdata.datasets.source import Listing, recordings_in
from nvsdata.remote.url import Url

MOST_CLASSES = 10  # shown in a notebook
MOST_FOLDERS = 5  # named in a message


def nothing_below(root: Path | Url, listing: Listing, tree: str, names: Collection[str]) -> str:
    """Return a message with the tree of folders that was expected below `root`, and the tree that was found.

    Args:
        root: the folder, or the URL of the store, in which no recordings were found.
        listing: the files below it.
        tree: the layout of the dataset as distributed.
        names: plain names (see `plain_name`) of classes and splits. A root with such a name is too deep: the message
            then suggests a folder above.
    """
    message = f"expected there: {tree}; found: {_summary(listing)}"
    if isinstance(root, Url):
        return message
    above = root.absolute()
    while plain_name(above.name) in names and above != above.parent:
        above = above.parent
    if above == root.absolute() and root.is_dir() and any("/" not in name for name in recordings_in(listing)):
        # recordings are directly in the root, not in a class folder
        above = above.parent
    return message if above == root.absolute() else f"{message}; the root must be a folder above, such as {above}"


def _summary(listing: Listing) -> str:
    folders = []
    for folder, files in listing.items():
        kinds = Counter(Path(name).suffix or name for name in files)
        counts = ", ".join(f"{count:,} {kind}" for kind, count in kinds.most_common(3))
        if files or folder != ".":
            folders.append(f"{folder}/ ({counts or 'no files of its own'})")
    if not folders:
        return "nothing"
    more = len(folders) - MOST_FOLDERS
    return ", ".join(folders[:MOST_FOLDERS]) + (f" and {more:,} more folders" if more > 0 else "")


def shape_made_by(make: Callable[[], Any]) -> str:
    """Make a sample, and return its shape as text; afterwards, the state of all random generators is restored."""
    states = torch.get_rng_state(), np.random.get_state(), random.getstate()  # noqa: NPY002
    try:
        return _shape(make())
    except Exception as error:  # a transform of the user's may raise anything
        return f"can't be made ({type(error).__name__}: {shown(error)})"
    finally:
        torch.set_rng_state(states[0])
        np.random.set_state(states[1])  # noqa: NPY002
        random.setstate(states[2])


def _shape(sample: Any) -> str:
    """Return kind and shape of a sample, such as "float32 [2, 34, 34]"; for a collection, also those of its items."""
    if isinstance(sample, (torch.Tensor, np.ndarray)):
        return f"{str(sample.dtype).removeprefix('torch.')} {list(sample.shape)}"
    if isinstance(sample, dict):
        return ", ".join(f"{key}: {_shape(value)}" for key, value in sample.items())
    if isinstance(sample, (list, tuple)) and sample:
        return f"{len(sample)} x {_shape(sample[0])}"
    return repr(sample).splitlines()[0]


def notebook_view(dataset: Any) -> str:
    """Return HTML with a dataset's repr and, for each of the first classes, an image of a recording."""
    # OpenCV is imported for images only
    from nvsdata.plots.gallery import ClassSummary, image_tags

    first: dict[int, int] = {}
    for index, sample in enumerate(dataset.samples):
        # pairs of recordings have no image
        if isinstance(sample, Sample):
            first.setdefault(sample.label, index)
    shelf = ClassSummary("", 0)
    for label in sorted(first)[:MOST_CLASSES]:
        try:
            shelf.show(dataset.classes[label], dataset.recording(first[label]).read())
        except (OSError, ValueError):
            continue
    text = as_html(repr(dataset), "\n")
    return f"<pre>{text}</pre>{image_tags(shelf, 'height: 80px; image-rendering: pixelated')}"
