"""Hypothesis strategies."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from nvsdata import Events


@st.composite
def events(draw, max_size=200, width=34, height=34, first=0, gap=2_000):
    """Sorted events with repeated times, repeated pixels and gaps of up to `gap` µs."""
    n = draw(st.integers(0, max_size))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    gaps = rng.integers(0, draw(st.sampled_from((1, 20, gap))) + 1, n)
    w, h = rng.integers(1, width + 1), rng.integers(1, height + 1)
    return Events(
        first + np.cumsum(gaps), rng.integers(0, w, n), rng.integers(0, h, n), rng.integers(0, 2, n), (width, height)
    )
