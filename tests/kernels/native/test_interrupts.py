"""Ctrl-C ends a call that takes long, before it is done."""

import signal
import sys

import numpy as np
import pytest

from nvsdata.kernels import _native

N = 1_000_000


@pytest.mark.skipif(sys.platform == "win32", reason="no such timer")
@pytest.mark.parametrize("sweep_below", [0, 10**9])
def test_a_search_for_neighbors_ends(sweep_below):
    def stop(*_):
        raise KeyboardInterrupt

    rng = np.random.default_rng(0)
    t, (x, y) = np.arange(N), rng.integers(0, 20, (2, N)).astype(np.int16)
    degree, source = np.zeros(N, np.int32), np.empty((N, 17), np.int32)
    before = signal.signal(signal.SIGALRM, stop)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(KeyboardInterrupt):
            _native.near_sources(t, x, y, 3.0, 1.0, 1e-4, sweep_below, degree, source)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert not degree.all()
