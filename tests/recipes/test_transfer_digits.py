"""Digits from emulated recordings to real ones, with a few drawn digits in place of scikit-learn's."""

import importlib
import json
import sys
from importlib.machinery import ModuleSpec
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from places import RECIPES

import nvsdata
from nvsdata import NMNIST, EventFolder


def bars():
    """Bars at another place for each class."""
    images = np.zeros((20, 8, 8))
    for n in range(20):
        left = n % 10 * 6 // 9
        images[n, 1:7, left : left + 2] = 16 - n // 10
    return SimpleNamespace(images=images, target=np.arange(20) % 10)


def test_four_cells_from_one_command(tmp_path, fake_nmnist, run, monkeypatch):
    for name in ("sklearn", "sklearn.datasets"):
        package = ModuleType(name)
        package.__spec__, package.load_digits = ModuleSpec(name, None), bars
        monkeypatch.setitem(sys.modules, name, package)
    monkeypatch.syspath_prepend(RECIPES)
    monkeypatch.setattr(importlib.import_module("transfer_digits"), "SOME", 20)
    words = "--real", fake_nmnist, "--out", tmp_path / "out", "--epochs", 1
    said = run("transfer_emulated.py", "--digits", *words)
    assert "emulating 40 digits by DVS(on=" in said
    table = json.loads((tmp_path / "out/table.json").read_text())
    assert list(table) == ["emulated -> emulated", "emulated -> real", "real -> emulated", "real -> real"]
    for single, voted in table.values():
        assert f"{single[0]:.3f} / {voted[0]:.3f}" in said

    emulated = NMNIST(tmp_path / "out/emulated", "all")
    assert np.bincount(emulated.targets).tolist() == [4] * 10
    counts = [len(emulated[i][0]) for i in range(40)]
    assert abs(np.mean(counts) / 4_108 - 1) < 0.05
    # the bar moves down at first: it gets dark above it, which N-MNIST calls ON
    events = emulated[0][0].window(0, 100_000)
    above = events.y < 12
    assert (events.p[above] == 1).mean() > 0.8
    for kind in ("emulated", "real"):
        assert nvsdata.models.load(tmp_path / "out" / kind / "model.safetensors").model is not None

    again = run("transfer_digits.py", *words, "--resume")
    assert "emulating" not in again
    assert json.loads((tmp_path / "out/table.json").read_text()) == table


def test_digits_on_any_sensor(tmp_path, run, monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.datasets", SimpleNamespace(load_digits=bars))
    monkeypatch.syspath_prepend(RECIPES)
    # thresholds are chosen on ten digits
    monkeypatch.setattr(importlib.import_module("transfer_digits"), "SOME", 10)
    words = "emulate_digits.py", "--out", tmp_path, "--size", 44, 40, "--events", 3_000, "--digits", 12
    assert "12 digits by DVS(on=" in run(*words)
    dataset = EventFolder(tmp_path)
    assert len(dataset) == 12
    recordings = [dataset[n][0] for n in range(12)]
    assert {events.sensor_size for events in recordings} == {(44, 40)}
    assert abs(np.mean([len(events) for events in recordings]) / 3_000 - 1) < 0.2
    # the digit is as large as the sensor allows, with its path
    assert all(np.ptp(events.y) > 24 for events in recordings)
    # a stopped run goes on
    gone = next(tmp_path.rglob("*.h5"))
    before = nvsdata.read(gone)
    gone.unlink()
    run(*words)
    again = nvsdata.read(gone)
    assert all(np.array_equal(getattr(again, name), getattr(before, name)) for name in "txyp")


def test_a_missing_package_is_named(tmp_path, fake_nmnist, run, monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.datasets", None)
    with pytest.raises(SystemExit, match=r"the digits are scikit-learn's: pip install 'nvsdata\[digits\]'"):
        run("transfer_digits.py", "--real", fake_nmnist, "--out", tmp_path / "out")
