import json

import numpy as np
import pytest
from places import RECIPES

from nvsdata import Events


@pytest.fixture
def spiking(monkeypatch):
    monkeypatch.syspath_prepend(RECIPES)
    import baselines
    import spiking

    # one or two choices of each setting, because selecting them takes longer than the rest
    for name in ("CELLS", "WINDOWS", "ROOTS", "PENALTIES", "SPIKING_CELLS"):
        monkeypatch.setattr(baselines, name, getattr(baselines, name)[-1:])
    monkeypatch.setattr(baselines, "SIMPLE", spiking.SIMPLE[:1])
    monkeypatch.setattr(spiking, "SIMPLE", spiking.SIMPLE[:2])
    monkeypatch.setattr(spiking, "CLASSES", spiking.CLASSES[:2])
    return spiking


def moving_line(angle, seed=0):
    """A line of 20 pixels that moves across itself by a pixel per ms, with the noise of a few pixels."""
    rng = np.random.default_rng(seed)
    along, step = np.meshgrid(np.arange(-10, 11), np.arange(-8, 9))
    x = 16 + along * -np.sin(angle) + step * np.cos(angle)
    y = 16 + along * np.cos(angle) + step * np.sin(angle)
    t = np.sort((step + 8).ravel() * 1_000 + rng.integers(0, 900, step.size))
    on = np.ones(step.size, np.uint8)
    return Events(t, x.round().ravel().astype(np.int16), y.round().ravel().astype(np.int16), on, (33, 33))


def test_filters_have_no_mean_the_same_norm_and_turn(spiking):
    filters = spiking.FILTERS
    assert filters.shape == (12, 7, 7)
    np.testing.assert_allclose(filters.mean((1, 2)), 0, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(filters, axis=(1, 2)), 100, rtol=1e-6)
    np.testing.assert_allclose(filters[6], np.rot90(filters[0]), atol=1e-4)
    assert filters[0, :, 3].min() > 0 > filters[0, :, 1].max()  # a vertical edge


@pytest.mark.parametrize("orientation", [0, 2, 6, 9])
def test_most_spikes_are_those_of_the_line_s_orientation(spiking, orientation):
    events = moving_line(np.pi * orientation / 12)
    counts = spiking.cell_spikes([events], spiking.SIMPLE[0], 4).reshape(12, -1).sum(1)
    assert counts.argmax() == orientation
    assert counts.sum() > 20


def test_roots_and_weights_of_classes(spiking):
    lines = [moving_line(0), moving_line(1)]
    plain, roots = (spikes(lines, spiking.SIMPLE[0], 8) for spikes in (spiking.cell_spikes, spiking.root_spikes))
    np.testing.assert_allclose(roots**2, plain, rtol=1e-6)
    weights = spiking.class_weights(np.array([[3, 0], [5, 0], [0.001, 1], [0, 0]], np.float32), np.array([2, 2, 5, 7]))
    np.testing.assert_allclose(weights, [[100, -1], [-1, 100], [-1, -1]], rtol=1e-4)


def test_classes_are_those_of_the_nearest_lines(spiking):
    angles = np.tile([0, np.pi / 3, np.pi / 2], 5)
    lines, labels = [moving_line(angle, seed) for seed, angle in enumerate(angles)], np.tile([3, 5, 9], 5)
    folds = [(list(range(6)), list(range(6, 15)))]
    settings, within = spiking.best_hfirst(lines, labels, folds)
    assert within == 1
    weights = spiking.class_weights(spiking.cell_spikes(lines[:6], settings["simple"], 4), labels[:6])
    silent = Events([0], [0], [0], [1], (33, 33))
    found = spiking.winners([*lines[6:], silent, silent[:0]], weights, **settings)
    assert found.tolist() == [0, 1, 2] * 3 + [-1, -1]


def test_all_baselines_are_reported(spiking, run, many, tmp_path):
    said = run("baselines.py", "--dataset", "n-mnist", "--root", many, "--out", tmp_path / "found.json")
    found = json.loads((tmp_path / "found.json").read_bytes())
    for name in ("HATS + SVM", "HOTS + SVM", "HOTS + histogram distance", "counts + SVM", "Gabor-SNN + SVM", "H-First"):
        value, low, high = found[name]["accuracy"]
        assert low <= value <= high
        assert f"{name}: accuracy on {found['test']} recordings, with a 95% interval: {value:.3f}" in said
    assert 0 <= found["H-First"]["without answer"] <= 1 - found["H-First"]["accuracy"][0]
