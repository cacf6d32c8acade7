"""Images for the datasets' pages, drawn when the site is built, from recordings on that machine.

The repository contains only N-MNIST's: the licenses of most datasets are unknown, or forbid redistribution. Datasets
that aren't on this machine get look-alikes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from look_alikes import look_alikes

import nvsdata
from nvsdata.commands.datasets import where
from nvsdata.data.author_graphs import read_author_graphs
from nvsdata.data.recording import as_events
from nvsdata.datasets import DATASETS
from nvsdata.plots import event_image
from nvsdata.plots.drawing import middle
from nvsdata.plots.sheets import captioned_sheet

HOME = "NVSDATA_DATASETS"  # names a folder of datasets, each in a folder or store of its name
SAMPLES = Path(__file__).parents[1].parent / "shared/data"
SHOWN = 8  # recordings on a picture
MILLISECONDS = 30
Tile = tuple[np.ndarray, list[str]]  # image and lines of its caption
# files below SAMPLES, and what they are
FOUND = {
    "n-cars": ("samples/*ncars*.dat", "A recording"),
    "mnist-dvs": ("samples/mnist_*.aedat", "Recordings, whose names have the digit and the scale"),
    "cifar10-dvs": ("author_graphs/cifar10-dvs/*.mat", "Nodes of graphs that the thesis's author released"),
    "ucf101-dvs": ("author_graphs/ucf101-dvs/*.mat", "Nodes of graphs that the thesis's author released"),
}


def picture(name: str) -> tuple[str, bytes] | None:
    """Return a caption and a PNG; None if this machine has nothing of the dataset."""
    text, tiles = _tiles(name)
    if not tiles:
        return None
    return f"{text}: ON in red, OFF in blue", _png(captioned_sheet(tiles, columns=4))


def thumbnail(name: str) -> bytes | None:
    """Return the first image of the picture as a PNG."""
    _, tiles = _tiles(name)
    return _png(tiles[0][0]) if tiles else None


def _png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


@cache
def _tiles(name: str) -> tuple[str, list[Tile]]:
    """Return a caption, and images with their own captions; none if this machine has nothing of the dataset."""
    text, tiles = f"{MILLISECONDS} ms of recordings", list(_of_dataset(name))
    if not tiles and name in FOUND:
        pattern, text = FOUND[name]
        tiles = [_tile(path) for path in sorted(SAMPLES.glob(pattern))[:SHOWN]]
    if not tiles and (drawn := look_alikes(name, DATASETS[name].info.sensor_size)):
        text = f"No recordings: {MILLISECONDS} ms of drawn scenes, emulated for this page"
        tiles = [(event_image(middle(events, MILLISECONDS * 1_000)), [caption]) for caption, events in drawn.items()]
    return text, tiles


def _of_dataset(name: str) -> Iterator[Tile]:
    """Yield an image of a recording of each of the first classes, if this machine has the dataset."""
    place = where(name, Path(os.environ[HOME])) if HOME in os.environ else None
    if place is None:
        return
    dataset = DATASETS[name](place, "all")
    labels = np.asarray(dataset.targets)
    for label in np.unique(labels)[:SHOWN].tolist():
        with suppress(OSError, ValueError):
            events = as_events(dataset[int(np.argmax(labels == label))][0])
            yield event_image(middle(events, MILLISECONDS * 1_000)), [dataset.classes[label]]


def _tile(path: Path) -> Tile:
    if path.suffix != ".mat":
        return event_image(middle(nvsdata.read(path), MILLISECONDS * 1_000)), [path.stem]
    graph = read_author_graphs(path)[0]
    x, y = graph.pos[:, :2].round().numpy().astype(int).T
    on = (graph.x[:, 0] > 0).numpy()
    return event_image(nvsdata.Events(np.zeros(len(x), int), x, y, on, graph.sensor_size)), [path.stem]
