"""One number for each of several settings (thesis 3.3.4)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def score(distances: npt.ArrayLike) -> np.ndarray:
    """Weighted score of each setting: the mean of its distances, L2-normalized over the settings (thesis 3.3.4).

    - `distances`: [settings, distances], smaller is better for all, such as `Comparison.values`; NaN stands for a
      setting without a result

    Returns float64 [settings]. A distance that is 0 for all settings adds 0. NaN gives NaN for its setting and is
    left out of the norms. ValueError for another shape.
    """
    table = np.asarray(distances, np.float64)
    if table.ndim != 2:
        raise ValueError(f"distances must be [settings, distances], not {table.shape}")
    norms = np.sqrt(np.nansum(table * table, axis=0))
    normalized = np.divide(table, norms, out=np.zeros_like(table), where=norms > 0)
    return np.asarray(np.where(np.isnan(table).any(1), np.nan, normalized.mean(1)))
