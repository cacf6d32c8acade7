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
    held: list[int] = []
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        order = members[np.argsort(draws[members], kind="stable")]
        held += order[: round(test * len(members))].tolist()
    chosen = set(held)
    return [i for i in range(len(targets)) if i not in chosen], sorted(held)
