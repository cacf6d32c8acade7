"""Spiking baselines of Table 4.7 of the thesis, for baselines.py.

Both begin with two layers of H-First (Orchard et al. 2015): leaky integrate-and-fire neurons with Gabor filters at each
pixel (S1), of which the first to spike inhibits the others, and cells of pixels that pass on first spikes (C1).

- H-First: a neuron for each class sees the spikes of all cells (S2, C2). Its weights are the mean numbers of these
  spikes in the training recordings of the class. The class with the most spikes is the answer, the first one of equals;
  without spikes there is none.
- Gabor-SNN (Sironi et al. 2018): a linear SVM classifies the square roots of the numbers of spikes of the cells.

Filters, cells of H-First and refractory periods are those of Orchard's program (github.com/gorchard/HFIRST). Thresholds
and leaks depend on the rate of events, so the best ones within the training set are selected.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np

from nvsdata import Events
from nvsdata.kernels.represent.hfirst import Neuron, spike_counts

ORIENTATIONS, SIDE = 12, 7  # side in pixels
SIGMA, WAVELENGTH, ASPECT = 2.8, 5.0, 0.3  # sigma and wavelength in pixels
NORM, REST, CELL = 100.0, 5_000, 4  # norm of weights in mV, refractory periods in µs, side of a cell in pixels
# threshold in mV and leak in mV per µs, of pixels and of classes; the first ones are Orchard's
SIMPLE = (150.0, 0.025), (150.0, 0.005), (75.0, 0.005), (75.0, 0.001)
CLASSES = (150.0, 0.001), (50.0, 0.001), (15.0, 0.001)
Setting = tuple[float, float]


def gabor_filters() -> np.ndarray:
    """Return Gabor filters float32 [orientations, side, side] in mV, with mean 0 and the same norm."""
    reach = SIDE // 2
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    angle = np.pi * np.arange(ORIENTATIONS)[:, None, None] / ORIENTATIONS
    across, along = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    waves = np.exp(-(across**2 + (ASPECT * along) ** 2) / (2 * SIGMA**2)) * np.cos(2 * np.pi * across / WAVELENGTH)
    waves -= waves.mean((1, 2), keepdims=True)
    waves *= NORM / np.linalg.norm(waves, axis=(1, 2), keepdims=True)
    return np.array(waves, np.float32)


FILTERS = gabor_filters()


def cell_spikes(recordings: list[Events], simple: Setting, cell: int) -> np.ndarray:
    """Return the numbers of spikes of the cells of recordings as rows."""
    none = np.zeros(0, np.float32)
    counts = np.stack([_spikes(one, simple, cell, none, CLASSES[0])[0] for one in recordings])
    return counts.reshape(len(counts), -1).astype(np.float32)


def root_spikes(recordings: list[Events], simple: Setting, cell: int) -> np.ndarray:
    """Return the square roots of `cell_spikes`, which is usual for histograms."""
    return np.sqrt(cell_spikes(recordings, simple, cell))


def class_weights(spikes: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return the weights of each class in mV: mean numbers of spikes of norm 100, or -1 where that is less than 1."""
    means = np.stack([spikes[labels == one].mean(0) for one in np.unique(labels)])
    means *= NORM / np.linalg.norm(means, axis=1, keepdims=True).clip(1e-9)
    return np.where(means < 1, np.float32(-1), means)


def winners(recordings: list[Events], weights: np.ndarray, simple: Setting, classes: Setting) -> np.ndarray:
    """Return the index of the class with the most spikes for each recording, or -1 if there are no spikes."""
    votes = np.stack([_spikes(one, simple, CELL, weights, classes)[1] for one in recordings])
    return np.where(votes.any(1), votes.argmax(1), -1)


def best_hfirst(
    recordings: list[Events], labels: np.ndarray, folds: Iterable[tuple[list[int], list[int]]]
) -> tuple[dict[str, Setting], float]:
    """Return the settings with the best mean accuracy over the folds, and that accuracy."""
    index = np.unique(labels, return_inverse=True)[1]
    found: dict[tuple[Setting, Setting], list[float]] = {both: [] for both in product(SIMPLE, CLASSES)}
    spikes = {simple: cell_spikes(recordings, simple, CELL) for simple in SIMPLE}
    for a, b in folds:
        for simple, classes in found:
            weights = class_weights(spikes[simple][a], labels[a])
            answers = winners([recordings[i] for i in b], weights, simple, classes)
            found[simple, classes].append((answers == index[b]).mean())
    best = max(found, key=lambda both: np.mean(found[both]))
    return {"simple": best[0], "classes": best[1]}, float(np.mean(found[best]))


def _spikes(
    events: Events, simple: Setting, cell: int, weights: np.ndarray, classes: Setting
) -> tuple[np.ndarray, np.ndarray]:
    width, height = events.sensor_size
    templates = weights.reshape(len(weights), ORIENTATIONS, -(-height // cell), -(-width // cell))
    neuron, of_class = Neuron(*simple, REST), Neuron(*classes, REST)
    return spike_counts(*events.columns, (width, height), FILTERS, neuron, cell, REST, templates, of_class)
