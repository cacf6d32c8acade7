"""Random splits that are the same everywhere for a seed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def stratified(targets: Sequence[int], test: float = 0.2, seed: int = 0) -> tuple[list[int], list[int]]:
    """Indices for training and testing: a share `test` of each class, drawn by `seed`.

    Both are sorted. Which samples are drawn depends on the targets' order and the seed alone.
    ValueError unless 0 < test < 1.
    """
    if not 0 < test < 1:
        raise ValueError(f"test must lie between 0 and 1, not {test}")
    # PCG64 with its raw draws: the stream is fixed by definition, not by numpy's version
    draws = np.random.PCG64(seed).random_raw(len(targets))
    labels = np.asarray(targets)
    names, counts = np.unique(labels, return_counts=True)
    held = np.zeros(len(labels), bool)
    for name, share in zip(names, _shares(counts, test), strict=True):
        members = np.flatnonzero(labels == name)
        held[members[np.argsort(draws[members], kind="stable")][:share]] = True
    return np.flatnonzero(~held).tolist(), np.flatnonzero(held).tolist()


def _shares(counts: np.ndarray, test: float) -> np.ndarray:
    """How many of each class to hold back: largest remainders, so that the sum is right too."""
    exact = counts * test
    shares = np.floor(exact).astype(int)
    missing = round(counts.sum() * test) - shares.sum()
    shares[np.argsort(shares - exact, kind="stable")[:missing]] += 1
    return shares
