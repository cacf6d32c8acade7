"""Correlation of numbers of events per pixel, and bootstrap over blocks of pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.data.events import Events

BLOCKS = 8  # blocks per side of the sensor
RESAMPLED = 500  # samples of a bootstrap
LEVEL = 0.95  # confidence level of intervals


def pixel_index(events: Events) -> np.ndarray:
    """Return the index y * width + x of each event's pixel."""
    return events.y.astype(np.int64) * events.sensor_size[0] + events.x


def count_images(events: Events) -> np.ndarray:
    """Return the numbers of OFF and of ON events of each pixel, float64 [2, H, W]."""
    width, height = events.sensor_size
    index = events.p * np.int64(width * height) + pixel_index(events)
    return np.bincount(index, minlength=2 * width * height).reshape(2, height, width).astype(float)


def correlation(ours: Events, real: Events) -> float:
    """Return the correlation of the numbers of events per pixel; 0 if either side has the same number at all pixels."""
    return pearson(count_images(ours).sum(axis=0), count_images(real).sum(axis=0))


def pearson(a: np.ndarray, b: np.ndarray) -> float:
    """Return Pearson's correlation coefficient of two arrays; 0 if either is constant."""
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / scale if scale else 0.0


class BlockBootstrap:
    """Samples of blocks of pixels with replacement; the first sample has each block once.

    Blocks are sampled rather than pixels, because nearby pixels record the same edges and are correlated. The sensor is
    divided into `BLOCKS` x `BLOCKS` blocks (fewer if a side has fewer pixels), and there are `RESAMPLED` samples.

    Args:
        shape: Height and width of the sensor.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self._edges = [np.linspace(0, side, min(BLOCKS, side), endpoint=False).astype(int) for side in shape]
        count = self._edges[0].size * self._edges[1].size
        drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), RESAMPLED)
        self._weights = np.vstack((np.ones(count), drawn))
        self._pixels = self.sums(np.ones(shape))

    def sums(self, image: np.ndarray) -> np.ndarray:
        """Return the sum of an image [H, W] over the blocks of each sample, float64 [samples]."""
        rows, columns = self._edges
        return np.asarray(self._weights @ np.add.reduceat(np.add.reduceat(image, rows, 0), columns, 1).ravel())

    def correlation(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return the correlation of two images [H, W] in each sample, float64 [samples]; 0 if either is constant."""
        # means are subtracted first, because differences of large sums lose precision
        a, b = a - a.mean(), b - b.mean()
        n, x, y = self._pixels, self.sums(a), self.sums(b)
        scale = np.sqrt(np.maximum((self.sums(a * a) - x * x / n) * (self.sums(b * b) - y * y / n), 0))
        found = np.zeros(n.size)
        np.divide(self.sums(a * b) - x * y / n, scale, out=found, where=scale > 0)
        return found


class Peak(NamedTuple):
    """Position of the maximum of a function in each sample of a bootstrap.

    Args:
        places: Vertices of the parabolas through the largest value and its neighbors, float64 [samples].
        low: Lower end of the 95% confidence interval.
        high: Upper end of the interval.
    """

    places: np.ndarray
    low: float
    high: float


def find_peak(places: np.ndarray, values: np.ndarray) -> Peak:
    """Return the peak of each column of `values` [places, samples]; a peak at an end of `places` isn't interpolated."""
    columns = np.arange(values.shape[1])
    best = values.argmax(axis=0)
    middle = best.clip(1, len(places) - 2)
    a, b, c = (places[middle + d] for d in (-1, 0, 1))
    u, v, w = (values[middle + d, columns] for d in (-1, 0, 1))
    top = (b - a) ** 2 * (v - w) - (b - c) ** 2 * (v - u)
    bend = (b - a) * (v - w) - (b - c) * (v - u)
    vertex = b - np.divide(top, 2 * bend, out=np.zeros(columns.size), where=bend != 0)
    found = np.where(best == middle, vertex.clip(a, c), places[best])
    return Peak(found, *interval(found))


def interval(samples: np.ndarray) -> tuple[float, float]:
    """Return the percentile interval of bootstrap samples, extended to contain the estimate, `samples[0]`."""
    low, high = np.quantile(samples[1:], ((1 - LEVEL) / 2, (1 + LEVEL) / 2)).tolist()
    return min(low, float(samples[0])), max(high, float(samples[0]))
