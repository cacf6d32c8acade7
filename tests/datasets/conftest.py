"""Distributions on disk."""

import shutil

import pytest
import trees

from nvsdata.datasets.archives.unpack import unpack


@pytest.fixture
def home(tmp_path):
    """A function that puts a distribution's files on disk, zips unpacked as `download` would."""

    def make(files):
        # a distribution takes the place of the one before
        shutil.rmtree(tmp_path / "data", ignore_errors=True)
        (tmp_path / "all.zip").write_bytes(trees.zipped(files))
        unpack(tmp_path / "all.zip", tmp_path / "data")
        return tmp_path / "data"

    return make
