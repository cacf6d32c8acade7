"""How alike two feature vectors are (thesis Table 5.4), and how well a score tells same from different (5.3.2)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

COUNT = 12
FLOOR = 1e-10  # the least that a logarithm is taken of


def similarities(a: npt.ArrayLike, b: npt.ArrayLike) -> np.ndarray:
    """The 12 similarities of Table 5.4 of vectors `a` and `b` [..., D], in its order: float64 [..., 12].

    Features are not negative, as after a ReLU. Conventions: 0/0 is 0; logarithms, in no. 10, are of at least 1e-10, so
    0 log 0 is 0, and a feature that only one of them has counts with a finite ratio. No. 5 sums absolute
    differences, and no. 12 divides by the product of the two sums.

    Finite for all finite features. ValueError for negative or infinite features, or shapes that differ.
    """
    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if x.shape != y.shape or x.ndim == 0:
        raise ValueError(f"a and b must be vectors of one shape [..., D], not {x.shape} and {y.shape}")
    for name, values in (("a", x), ("b", y)):
        if not np.isfinite(values).all() or (values < 0).any():
            raise ValueError(f"{name} must hold finite features that are not negative")
    both, product, least = x + y, x * y, np.minimum(x, y)
    root_x, root_y = np.sqrt(x), np.sqrt(y)
    logs = np.log(np.maximum(x, FLOOR)) - np.log(np.maximum(y, FLOOR))

    def total(values: np.ndarray) -> np.ndarray:
        return np.asarray(values.sum(-1))

    dot = total(product)
    columns = (
        dot,
        np.sqrt(dot),
        np.sqrt(total(root_x * root_y)),
        np.sqrt(total(_ratio(product, both))),
        total(np.abs(x - y)),
        np.sqrt(total(_ratio((x - y) ** 2, both))),
        _ratio(dot, np.sqrt(total(x * x)) * np.sqrt(total(y * y))),
        np.sqrt(total((root_x - root_y) ** 2)),
        np.sqrt(total((x - y) ** 2)),
        total((x - y) * logs) / 2,
        total(_ratio(np.sqrt(np.maximum(x, y)), np.sqrt(both))),
        _ratio(total(least), total(x) * total(y)),
    )
    return np.stack(columns, -1)


def roc(scores: npt.ArrayLike, same: npt.ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """False and true positive rates, float64, for every threshold from above the highest score down.

    `scores` [N], the higher the more likely the same; `same` [N] 1 or 0. Equal scores make one step.
    ValueError unless there are some of both kinds.
    """
    values, truth = np.asarray(scores, np.float64), np.asarray(same).astype(bool)
    if truth.all() or not truth.any():
        raise ValueError("pairs that are the same and pairs that differ are both needed")
    order = np.argsort(-values, kind="stable")
    ends = np.append(np.flatnonzero(np.diff(values[order])), values.size - 1)
    hits, alarms = np.cumsum(truth[order])[ends], np.cumsum(~truth[order])[ends]
    return np.append(0.0, alarms / (~truth).sum()), np.append(0.0, hits / truth.sum())


def area_under_roc(scores: npt.ArrayLike, same: npt.ArrayLike) -> float:
    """Area under `roc`: the probability that a pair of the same scores higher than one that differs."""
    return float(np.trapezoid(*roc(scores, same)[::-1]))


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a / b, and 0 where b is 0 (there a is, too)."""
    return np.asarray(np.divide(a, b, out=np.zeros(np.broadcast(a, b).shape), where=b > 0))
