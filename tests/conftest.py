"""What tests share: hypothesis strategies, small datasets, the folder of real recordings."""

from __future__ import annotations

import os
import runpy
import sys
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:
    # before torch is imported: each worker has a core, and several threads would only get into each other's way
    os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, settings

SHARED = Path(__file__).parents[2] / "shared" / "data"
RECIPES = Path(__file__).parents[1] / "recipes"

settings.register_profile(
    "suite",
    deadline=None,
    max_examples=60,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("suite")


@pytest.fixture(autouse=True)
def _seeded():
    torch.manual_seed(0)


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


def saccade(rng: np.random.Generator, digit: int, n: int) -> tuple[np.ndarray, ...]:
    """Columns t, x, y, p of a bar that sweeps the sensor at an angle given by the digit."""
    t = np.sort(rng.integers(0, 100_000, n))
    along = rng.uniform(-12, 12, n)
    across = 10 * np.sin(2 * np.pi * t / 100_000)
    c, s = np.cos(digit * np.pi / 10), np.sin(digit * np.pi / 10)
    x = np.clip(17 + c * along - s * across, 0, 33).astype(int)
    y = np.clip(17 + s * along + c * across, 0, 33).astype(int)
    return t, x, y, rng.integers(0, 2, n)


def atis_bytes(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> bytes:
    """ATIS records, straight from the format's description."""
    out = bytearray()
    for ti, xi, yi, pi in zip(t.tolist(), x.tolist(), y.tolist(), p.tolist(), strict=True):
        out += bytes([xi, yi, pi << 7 | ti >> 16, ti >> 8 & 0xFF, ti & 0xFF])
    return bytes(out)


@pytest.fixture
def run(monkeypatch, capsys):
    """Runs a recipe in this process, which saves starting torch anew, and gives what it printed."""

    def run(recipe, *arguments):
        monkeypatch.setattr(sys, "argv", [recipe, *map(str, arguments)])
        runpy.run_path(str(RECIPES / recipe), run_name="__main__")
        return capsys.readouterr().out

    return run
