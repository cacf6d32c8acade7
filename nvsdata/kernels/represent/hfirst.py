"""Layers of H-First (Orchard et al. 2015): spiking neurons whose first spikes inhibit the others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels import _native

LANES = 16  # potentials of a pixel fill vector registers


class Neuron(NamedTuple):
    """A leaky integrate-and-fire neuron: its potential moves to 0 by `leak`; above `threshold` it spikes."""

    threshold: float  # mV
    leak: float  # mV per µs
    refractory: int  # µs


def spike_counts(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    sensor_size: tuple[int, int],
    filters: np.ndarray,
    simple: Neuron,
    cell: int,
    pause: int,
    templates: np.ndarray,
    classes: Neuron,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of spikes of complex cells int64 [K, rows, columns], and of classes int64 [C].

    - Simple cells: at each pixel, a neuron per polarity and filter. An event adds `filters` float32 [K, side, side]
      (mV, odd side) to the neurons around it. Of the neurons of a pixel and polarity above the threshold,
      the one with the highest potential spikes; all of them are then reset to 0, and refractory.
    - Complex cells: one per filter and cell of `cell` x `cell` pixels passes on the spikes of its simple cells, but
      none within `pause` µs of the last one.
    - Classes: such a spike adds its value of `templates` float32 [C, K, rows, columns] (mV, none if C is 0) to the
      neuron of each class. The highest one above the threshold spikes; all are reset, and refractory.

    Potentials are float32. An input `refractory` µs after a spike is the first to be taken. O(N K side²). Events
    outside raise an IndexError.
    """
    width, height = sensor_size
    counts = np.zeros((len(filters), -(-height // cell), -(-width // cell)), np.int64)
    votes = np.zeros(len(templates), np.int64)
    lanes = -(-len(filters) // LANES) * LANES
    potentials, clocks = np.zeros((2, height, width, lanes), np.float32), np.zeros((2, height, width, 2), np.uint64)
    _native.spike_counts(
        t, x, y, p, filters, *simple, cell, pause, templates, *classes, potentials, clocks, counts, votes
    )
    return counts, votes
