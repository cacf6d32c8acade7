"""Loops that are compiled for several instruction sets give the same bits with each."""

import hashlib
import os
import subprocess
import sys

import numpy as np

from nvsdata.kernels.graph import pool, spline
from nvsdata.kernels.metrics.distances import least_work


def results():
    """A digest of what all these loops return."""
    rng = np.random.default_rng(0)
    digest = hashlib.sha256()
    for kind in (np.float32, np.float64):
        for channels, nodes, edges in ((1, 40, 500), (3, 9, 130), (37, 60, 1_000)):
            source, target = rng.integers(0, nodes, edges), np.sort(rng.integers(0, nodes, edges))
            u, x = rng.random((edges, 2)).astype(kind), rng.standard_normal((nodes, channels)).astype(kind)
            x[::7, 0] = np.nan
            sums = spline.dense_sums(source, target, u, 5, x)
            _, rows, into, of, share = spline.spline_plan(source, target, u, 5, nodes)
            out, onto = np.zeros((len(rows), channels), kind), x.copy()
            spline.add_shares(out, into, x, of, share)
            spline.add_rows(onto, rows, out)
            cluster = rng.integers(0, 8, nodes)
            for array in (sums, into, share, out, onto, *pool.max_rows(x, cluster, 8), *pool.mean_rows(x, cluster, 8)):
                # the sign of a NaN is nobody's business
                digest.update(np.where(array == array, array, 0).tobytes())
    a, b = (rng.random((2, n)) for n in (37, 44))
    digest.update(np.float64(least_work(*a, rng.integers(1, 9, 37), *b, rng.integers(1, 9, 44))).tobytes())
    return digest.hexdigest()


def test_all_instruction_sets_agree():
    found = set()
    for name in ("v2", "v3", "v4"):
        environment = os.environ | {"NVSDATA_CPU": name}
        done = subprocess.run([sys.executable, __file__], capture_output=True, text=True, env=environment, check=True)
        found.add(done.stdout)
    assert len(found) == 1


if __name__ == "__main__":
    print(results())
