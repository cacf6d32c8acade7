"""How a notebook shows a dataset."""

from __future__ import annotations

from typing import Any

from nvsdata.common.markup import as_html as escaped
from nvsdata.datasets.facts import Sample
from nvsdata.plots.gallery import ClassSummary, image_tags

MOST = 10  # classes shown


def as_html(dataset: Any) -> str:
    """What an `EventDataset`'s repr says, and a recording of each of the first classes, if it can be read."""
    first: dict[int, int] = {}
    for index, sample in enumerate(dataset.samples):
        # pairs of recordings have no picture
        if isinstance(sample, Sample):
            first.setdefault(sample.label, index)
    shelf = ClassSummary("", 0)
    for label in sorted(first)[:MOST]:
        try:
            shelf.show(dataset.classes[label], dataset.recording(first[label]).read())
        except (OSError, ValueError):
            continue
    text = escaped(repr(dataset), "\n")
    return f"<pre>{text}</pre>{image_tags(shelf, 'height: 80px; image-rendering: pixelated')}"
