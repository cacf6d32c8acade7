import os
import pickle
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest
from torch.multiprocessing import get_context

from nvsdata import NMNIST
from nvsdata.common.memory import SharedArray


def add_one(shared):
    shared.values[1] += 1


def test_processes_that_start_later_count_in_one_place():
    if os.name != "posix":
        pytest.skip("other systems spawn only")
    shared = SharedArray(3, np.int64)
    shared.values[0] = 7
    for method in ("fork", "spawn"):
        process = get_context(method).Process(target=add_one, args=(shared,))
        process.start()
        process.join()
    assert shared.values.tolist() == [7, 2, 0]


def test_a_copy_by_pickle_begins_with_the_counts_so_far():
    shared = SharedArray(3, np.uint8)
    shared.values[2] = 5
    copy = pickle.loads(ForkingPickler.dumps(shared))
    assert copy.values.tolist() == [0, 0, 5]


def test_a_thousand_slices_hold_no_descriptors(fake_nmnist):
    resource = pytest.importorskip("resource", reason="limits as POSIX has them")
    dataset = NMNIST(fake_nmnist, seed=0, errors="skip")
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(128, soft), hard))
    try:
        kept = [dataset[:5] for _ in range(1_000)]
        assert len(kept[-1][0][0]) == len(dataset[0][0])
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
