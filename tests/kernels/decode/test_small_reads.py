"""Small reads from open files, against slices of their bytes."""

import os
import tempfile

import numpy as np
import pytest

from nvsdata.kernels.decode.store import read_samples

DATA = bytes(range(256)) * 4


@pytest.mark.skipif(not hasattr(os, "pread"), reason="the system has no such reads")
@pytest.mark.parametrize("begin", [0, 3, 1000, 1023, 1024, 5000, -1, -(1 << 63), (1 << 63) - 1])
@pytest.mark.parametrize("step", [1, 7, 100, 1 << 62])
@pytest.mark.parametrize("size", [1, 20])
def test_rows_are_those_of_the_bytes(begin, step, size):
    with tempfile.TemporaryFile() as file:
        file.write(DATA)
        file.flush()
        for rows in (0, 1, 5, 100):
            out = np.zeros((rows, size), np.uint8)
            places = [begin + i * step for i in range(rows)]
            whole = [0 <= at <= len(DATA) - size for at in places]
            count = whole.index(False) if False in whole else rows
            assert read_samples(file.fileno(), begin, step, out) == count
            assert [row.tobytes() for row in out[:count]] == [DATA[at : at + size] for at in places[:count]]
        assert file.tell() == len(DATA)


def test_no_file_has_no_bytes():
    assert read_samples(-1, 0, 1, np.zeros((3, 2), np.uint8)) == 0
