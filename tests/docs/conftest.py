"""A folder with what the documentation's snippets talk about."""

import shutil
import sys
from pathlib import Path

import pytest
import trees
from clips import moving_square, write_video

import nvsdata

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))


@pytest.fixture(scope="session")
def furnished(tmp_path_factory):
    """Datasets, recordings and videos by the names that pages use."""
    tmp_path = tmp_path_factory.mktemp("desk")
    trees.put(tmp_path / "N-MNIST", trees.nmnist())
    trees.put(tmp_path / "UCF101-DVS", trees.ucf101dvs())
    events = nvsdata.example().window(0, 100_000)
    for name in ("a.h5", "a.dat", "a.aedat", "emulated.h5", "real.aedat"):
        nvsdata.write(events, tmp_path / name)
    for label in ("one", "two"):
        for n in range(2):
            (tmp_path / "recordings" / label).mkdir(parents=True, exist_ok=True)
            nvsdata.write(events, tmp_path / f"recordings/{label}/{n}.h5")
            write_video(tmp_path / f"ucf101/{label}/{n}.avi", moving_square(6))
    write_video(tmp_path / "video.mp4", moving_square(6))
    return tmp_path


@pytest.fixture
def desk(furnished, tmp_path):
    """A working folder with what pages talk about."""
    return Path(shutil.copytree(furnished, tmp_path, dirs_exist_ok=True))
