"""Classify recordings with the baselines of Table 4.7 of the thesis: HATS, HOTS, H-First and Gabor-SNN.

    python recipes/baselines.py --dataset n-mnist --root N-MNIST --out baselines.json

Entire recordings are classified. If the data has no test split, a random fifth of each class is the test set, as in
train_objects.py.

- HATS (Sironi et al. 2018): averaged time surfaces and a linear SVM, as in the paper. The cell, the window and the
  penalty of the SVM are the best ones on three random fifths of the training set, or of 1,000 of its recordings.
- HOTS (Lagorce et al. 2017): three layers of prototypes of time surfaces, found by k-means. Histograms of the
  prototypes of the last layer are classified by a linear SVM, or by the Bhattacharyya distance to the mean of each
  class.
- H-First (Orchard et al. 2015) and Gabor-SNN (Sironi et al. 2018): spiking neurons, described in spiking.py. Their
  thresholds, leaks and cells are selected as those of HATS.
- Counts: the numbers of events per pixel and a linear SVM, for comparison.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.optimize import minimize
from spiking import CELL, SIMPLE, best_hfirst, cell_spikes, class_weights, root_spikes, winners

from nvsdata import transforms as T
from nvsdata.common.files import atomic
from nvsdata.datasets import DATASETS
from nvsdata.datasets.splits import stratified
from nvsdata.kernels.represent.hots import feature_surfaces, nearest_prototypes
from nvsdata.metrics import accuracy
from nvsdata.training import TrainTestSplit, run

# side of a cell in pixels; window in µs; square root of the features, which is usual for histograms
CELLS, WINDOWS, ROOTS = (5, 7, 10), (10_000, 100_000), (False, True)
SPIKING_CELLS = (4, 8)
PENALTIES = (0.1, 1.0, 10.0, 100.0)
COMPARED = 1_000  # largest number of training recordings on which settings are compared
# prototypes, radius in pixels and time constant in µs of each layer of HOTS; surfaces for k-means
LAYERS = ((4, 2, 20_000.0), (8, 4, 40_000.0), (16, 8, 80_000.0))
SEEN = 8_000


def main() -> None:
    args = arguments()
    halves = TrainTestSplit(args.dataset, args.root, seed=args.seed)
    sets = halves.train(lambda recording: recording.read()), halves.test(lambda recording: recording.read())
    (train, labels), (test, truth) = (_loaded(part) for part in sets)
    found: dict[str, Any] = {"train": len(train), "test": len(test), "seed": args.seed}
    for name, result in _results(train, test, labels, truth, halves.sensor_size, args.seed):
        print(f"{name}: accuracy on {len(test)} recordings, with a 95% interval: {result['accuracy']:.3f}", flush=True)
        found[name] = result
    with atomic(args.out) as temporary:
        temporary.write_text(json.dumps(found, indent=1) + "\n")


def _results(
    train: list[Any], test: list[Any], labels: np.ndarray, truth: np.ndarray, sensor_size: tuple[int, int], seed: int
) -> Iterator[tuple[str, dict[str, Any]]]:
    counts = [np.stack([T.EventImage()(one).numpy().ravel() for one in part]) for part in (train, test)]
    yield "counts + SVM", _by_svm(*counts, labels, truth)
    del counts
    yield "HATS + SVM", _by_features(averaged_surfaces, _settings_of_hats(), train, test, labels, truth)
    settings = [{"simple": simple, "cell": cell} for simple, cell in product(SIMPLE, SPIKING_CELLS)]
    yield "Gabor-SNN + SVM", _by_features(root_spikes, settings, train, test, labels, truth)
    yield "H-First", _hfirst(train, test, labels, truth)
    histograms = hots(train, test, sensor_size, seed)
    yield "HOTS + histogram distance", {"accuracy": accuracy(_nearest(*histograms, labels) == truth)}
    yield "HOTS + SVM", _by_svm(*histograms, labels, truth)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--dataset",
        required=True,
        choices=sorted(DATASETS),
        help='dataset; "folder" is any folder with a subfolder for each class',
    )
    parser.add_argument("--root", required=True, type=Path, help="folder or packed store of the recordings")
    parser.add_argument("--out", type=Path, required=True, help="JSON file for the accuracies")
    parser.add_argument("--seed", type=int, default=0, help="seed of the split and of k-means (default 0)")
    return parser.parse_args()


def _loaded(part: Any) -> tuple[list[Any], np.ndarray]:
    pairs = [part[i] for i in range(len(part))]
    return [events for events, _ in pairs], np.array([label for _, label in pairs])


def _by_features(
    features: Callable[..., np.ndarray],
    options: Iterable[dict[str, Any]],
    train: list[Any],
    test: list[Any],
    labels: np.ndarray,
    truth: np.ndarray,
) -> dict[str, Any]:
    """Classify features by an SVM, with the settings that are best within the training set."""
    settings, penalty, within = _best_settings(features, options, train, labels)
    sets = [features(part, **settings) for part in (train, test)]
    return _test(*sets, labels, truth, penalty, within) | settings


def best_hats(train: list[Any], labels: np.ndarray) -> tuple[dict[str, Any], float, float]:
    """Return the settings of HATS and the penalty that are best within the training set, and their accuracy there."""
    return _best_settings(averaged_surfaces, _settings_of_hats(), train, labels)


def _settings_of_hats() -> list[dict[str, Any]]:
    options = product(CELLS, WINDOWS, ROOTS)
    return [{"cell": cell, "window": window, "root": root} for cell, window, root in options]


def _best_settings(
    features: Callable[..., np.ndarray], options: Iterable[dict[str, Any]], train: list[Any], labels: np.ndarray
) -> tuple[dict[str, Any], float, float]:
    some = _selection(labels)
    tried = []
    for settings in options:
        penalty, within = _best_penalty(features([train[i] for i in some], **settings), labels[some])
        tried.append((within, penalty, settings))
    within, penalty, settings = max(tried, key=lambda one: one[0])
    return settings, penalty, within


def _hfirst(train: list[Any], test: list[Any], labels: np.ndarray, truth: np.ndarray) -> dict[str, Any]:
    some = _selection(labels)
    settings, within = best_hfirst([train[i] for i in some], labels[some], _folds(labels[some]))
    weights = class_weights(cell_spikes(train, settings["simple"], CELL), labels)
    found = winners(test, weights, **settings)
    right = (found >= 0) & (np.unique(labels)[found] == truth)
    silent = float((found < 0).mean())
    return {"accuracy": accuracy(right), "within training": within, "without answer": silent} | settings


def averaged_surfaces(events: list[Any], cell: int, window: int, root: bool) -> np.ndarray:
    """Return the HATS of recordings as rows, or their square roots."""
    transform = T.HATS(cell, window=window)
    # not by np.stack, which needs twice the memory
    features = np.empty((len(events), transform(events[0]).numel()), np.float32)
    for row, one in zip(features, events, strict=True):
        row[:] = transform(one).numpy().ravel()
    return np.sqrt(features, out=features) if root else features


def _by_svm(train: np.ndarray, test: np.ndarray, labels: np.ndarray, truth: np.ndarray) -> dict[str, Any]:
    some = _selection(labels)
    penalty, within = _best_penalty(train[some], labels[some])
    return _test(train, test, labels, truth, penalty, within)


def _test(
    train: np.ndarray, test: np.ndarray, labels: np.ndarray, truth: np.ndarray, penalty: float, within: float
) -> dict[str, Any]:
    right = svm(*prepared(train, test), labels, penalty) == truth
    return {"accuracy": accuracy(right), "within training": within, "penalty": penalty}


def _selection(labels: np.ndarray) -> np.ndarray:
    """Return the indices of the training recordings on which settings are compared; they are in order of class."""
    return np.linspace(0, labels.size - 1, min(labels.size, COMPARED)).astype(int)


def _best_penalty(features: np.ndarray, labels: np.ndarray) -> tuple[float, float]:
    """Return the penalty with the best mean accuracy on three random fifths, and that accuracy."""
    found: dict[float, list[float]] = {penalty: [] for penalty in PENALTIES}
    for a, b in _folds(labels):
        sets = prepared(features[a], features[b])
        for penalty in PENALTIES:
            found[penalty].append((svm(*sets, labels[a], penalty) == labels[b]).mean())
    best = max(found, key=lambda penalty: np.mean(found[penalty]))
    return best, float(np.mean(found[best]))


def _folds(labels: np.ndarray) -> list[tuple[list[int], list[int]]]:
    """Return three random splits of recordings, as indices for training and a fifth for testing."""
    names = [(str(label), str(i)) for i, label in enumerate(labels)]
    return [stratified(names, 0.2, seed=seed) for seed in range(3)]


def prepared(train: np.ndarray, test: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Subtract the mean of the training set, and divide by the root of the sum of its variances.

    The weights of an SVM are linear combinations of the training features. If these are few, and fewer than their
    dimensions, coordinates in their span take the place of features.
    """
    mean = train.mean(0, dtype=np.float64)
    # some rows at a time, because their squares in float64 need twice the memory
    squares = sum(np.square(rows, dtype=np.float64).sum() for rows in np.array_split(train, 50))
    size = np.sqrt(squares / len(train) - mean @ mean)
    train, test = (part - mean.astype(part.dtype) for part in (train, test))
    for part in (train, test):
        part /= part.dtype.type(size)
    if len(train) < min(train.shape[1], COMPARED):
        axes, coordinates = np.linalg.qr(train.T.astype(np.float64))
        return coordinates.T, test @ axes
    return train, test


def svm(train: np.ndarray, test: np.ndarray, labels: np.ndarray, penalty: float) -> np.ndarray:
    """Return the classes of `test` by linear one-vs-rest SVMs with squared hinge loss (as in LIBLINEAR)."""
    classes = np.unique(labels)
    sign = np.where(labels[:, None] == classes, 1.0, -1.0)
    shape = train.shape[1] + 1, classes.size

    def scores(part: np.ndarray, w: np.ndarray) -> np.ndarray:
        return part @ w[:-1].astype(part.dtype) + w[-1]

    def loss(flat: np.ndarray) -> tuple[float, np.ndarray]:
        w = flat.reshape(shape)
        hinge = np.maximum(1 - sign * scores(train, w), 0)
        pull = sign * hinge
        slope = w - 2 * penalty * np.vstack((train.T @ pull.astype(train.dtype), pull.sum(0)))
        return 0.5 * (w**2).sum() + penalty * (hinge**2).sum(), slope.ravel()

    weights = minimize(loss, np.zeros(np.prod(shape)), jac=True, method="L-BFGS-B", options={"maxiter": 200}).x
    return classes[np.argmax(scores(test, weights.reshape(shape)), 1)]


def hots(train: list[Any], test: list[Any], sensor_size: tuple[int, int], seed: int) -> list[np.ndarray]:
    """Return histograms of the prototypes of the last layer, for training and for testing; each sums to 1."""
    rng = np.random.default_rng(seed)
    features, found = 2, [[events.p.astype(np.int64) for events in part] for part in (train, test)]
    longest = max(events.duration for events in (*train, *test))
    if longest > 500 * LAYERS[0][2]:
        raise ValueError(
            f"a recording of {longest / 1e6:.1f} s: the first layer of HOTS supports up to 10 s; cut the recordings"
        )
    for count, radius, tau in LAYERS:
        shape = features, sensor_size[1] + 2 * radius, sensor_size[0] + 2 * radius
        side = 2 * radius + 1
        surfaces = []
        for events, feature in zip(train, found[0], strict=True):
            wanted = np.sort(rng.choice(len(events), min(-(-SEEN // len(train)), len(events)), replace=False))
            out = np.empty((wanted.size, features, side, side), np.float32)
            feature_surfaces(events.t, events.x, events.y, feature, tau, radius, wanted, np.zeros(shape), out)
            surfaces.append(out.reshape(wanted.size, -1))
        centers, _ = kmeans2(np.concatenate(surfaces), count, minit="++", seed=rng)
        prototypes = centers.reshape(count, features, side, side).astype(np.float32)
        for part, there in zip((train, test), found, strict=True):
            for number, events in enumerate(part):
                new = np.zeros(len(events), np.int64)
                columns = events.t, events.x, events.y, there[number]
                nearest_prototypes(*columns, tau, radius, prototypes, np.zeros(shape), new)
                there[number] = new
        features = count
    counts = [np.stack([np.bincount(one, minlength=features) for one in part]) for part in found]
    return [part / part.sum(1, keepdims=True).clip(1) for part in counts]


def _nearest(train: np.ndarray, test: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return the classes of histograms with the smallest Bhattacharyya distance to the mean of the class."""
    classes = np.unique(labels)
    means = np.stack([train[labels == one].mean(0) for one in classes])
    return classes[np.argmax(np.sqrt(test) @ np.sqrt(means).T, 1)]


if __name__ == "__main__":
    run(main, "run the command again")
