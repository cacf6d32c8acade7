"""A small file of HDF5, which tests damage."""

import numpy as np
import pytest

import nvsdata
from nvsdata import Events


@pytest.fixture
def ev():
    n = 1_000
    return Events(np.arange(n), np.arange(n) % 30, np.arange(n) % 20, np.arange(n) % 2, (30, 20))


@pytest.fixture
def path(tmp_path, ev):
    nvsdata.write(ev, tmp_path / "a.h5")
    return tmp_path / "a.h5"
