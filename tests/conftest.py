"""What tests share: hypothesis strategies, small datasets, the folder of real recordings."""

from __future__ import annotations

import gc
import os
import runpy
import signal
import sys
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:
    # before torch is imported: each worker has a core, and several threads would only get into each other's way
    os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest
import torch

if not torch.cuda.is_available():
    # before anything imports Triton, as parts of torch do: its kernels then run on the CPU
    os.environ.setdefault("TRITON_INTERPRET", "1")

from hypothesis import HealthCheck, settings
from lookalikes import atis_bytes, saccade
from places import RECIPES, SHARED

from nvsdata.datasets import DATASETS
from nvsdata.formats import FORMATS
from nvsdata.models import NETWORKS, spline, spline_sum
from nvsdata.transforms import TRANSFORMS

# a shell's background job ignores the one, nohup the other; some tests send them
for name, usual in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    number = getattr(signal, name, None)
    if number is not None and signal.getsignal(number) == signal.SIG_IGN:
        signal.signal(number, usual)

settings.register_profile(
    "suite",
    deadline=None,
    max_examples=40,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("suite")


def pytest_collection_finish():
    # what libraries and tests are made of stays: it needn't be gone through whenever garbage is collected
    gc.freeze()


# torch.manual_seed formats the stack three times a call where no device is there whose seed could be set
DEVICES = torch.cuda.is_available() or torch.backends.mps.is_available()
seed = torch.manual_seed if DEVICES else torch.default_generator.manual_seed


@pytest.fixture
def same_registries(monkeypatch):
    """Forget what a test registers."""
    for known in (DATASETS, FORMATS, TRANSFORMS, NETWORKS):
        known.load_installed()
        monkeypatch.setattr(known, "_known", dict(known._known))


@pytest.fixture(autouse=True)
def _seeded():
    seed(0)


@pytest.fixture(params=["dense", "sparse", "torch"])
def spline_way(request, monkeypatch) -> str:
    """Each way that the B-spline convolution can go."""
    if request.param == "torch":
        monkeypatch.setattr(spline, "spline_sum", spline_sum.spline_sum_torch)
    else:
        monkeypatch.setattr(spline_sum, "DENSE", 10**9 if request.param == "dense" else 0)
    return request.param


@pytest.fixture
def real_nmnist() -> Path:
    """Real N-MNIST recordings; the test is skipped where there are none."""
    folder = SHARED / "N-MNIST"
    if not folder.is_dir():
        pytest.skip("no real recordings here")
    return folder


@pytest.fixture
def shared_samples() -> Path:
    """Real recordings in other formats; the test is skipped where there are none."""
    folder = SHARED / "samples"
    if not folder.is_dir():
        pytest.skip("no real recordings here")
    return folder


@pytest.fixture
def fake_nmnist(tmp_path: Path) -> Path:
    """N-MNIST's layout with 4 training and 2 test recordings a digit, made byte by byte."""
    rng = np.random.default_rng(0)
    for split, count in (("Train", 4), ("Test", 2)):
        for digit in range(10):
            folder = tmp_path / "N-MNIST" / split / str(digit)
            folder.mkdir(parents=True)
            for i in range(count):
                (folder / f"{i + 1:05d}.bin").write_bytes(atis_bytes(*saccade(rng, digit, 600)))
    return tmp_path / "N-MNIST"


@pytest.fixture
def run(monkeypatch, capsys):
    """Runs a recipe in this process, which saves starting torch anew, and gives what it printed."""

    def run(recipe, *arguments):
        monkeypatch.setattr(sys, "argv", [recipe, *map(str, arguments)])
        # as if it had been started by its path
        monkeypatch.syspath_prepend(RECIPES)
        runpy.run_path(str(RECIPES / recipe), run_name="__main__")
        return capsys.readouterr().out

    return run


@pytest.fixture
def headless(monkeypatch):
    """SDL without a display."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.fixture(scope="module")
def cluster():
    """A Dask cluster of two processes on this computer; its threads would disturb other modules' tests."""
    distributed = pytest.importorskip("distributed")
    there = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**there) as found:
        yield found
