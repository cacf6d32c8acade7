import os
import pickle
import subprocess
import sys
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest
from torch.multiprocessing import get_context

from nvsdata.datasets.shared import Shared


def add_one(shared):
    shared.values[1] += 1


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_processes_that_start_later_count_in_one_place(method):
    if os.name != "posix":
        pytest.skip("other systems spawn only")
    shared = Shared(3, np.int64)
    shared.values[0] = 7
    for _ in range(2):
        process = get_context(method).Process(target=add_one, args=(shared,))
        process.start()
        process.join()
    assert shared.values.tolist() == [7, 2, 0]


def test_a_copy_by_pickle_begins_with_the_counts_so_far():
    shared = Shared(3, np.uint8)
    shared.values[2] = 5
    copy = pickle.loads(ForkingPickler.dumps(shared))
    assert copy.values.tolist() == [0, 0, 5]


@pytest.mark.skipif(os.name != "posix", reason="limits as POSIX has them")
def test_thousands_of_slices_hold_no_descriptors(fake_nmnist):
    code = f"""
import resource
resource.setrlimit(resource.RLIMIT_NOFILE, (128, 128))
from nvsdata import NMNIST
dataset = NMNIST({str(fake_nmnist)!r}, seed=0, errors="skip")
kept = [dataset[:5] for _ in range(1_000)]
assert len(kept[-1][0][0]) == len(dataset[0][0])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
