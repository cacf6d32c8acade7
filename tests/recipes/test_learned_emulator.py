"""Learned emulators, on frames of a simulated sensor whose thresholds are known."""

import json

import cv2
import numpy as np
import pytest
import torch
from places import RECIPES

from nvsdata.emulation import DVS
from nvsdata.video.frames import VideoFrame

HIDDEN = DVS(on=0.35, off=0.25, dark=8, upsample="flow")


@pytest.fixture
def recipe(monkeypatch):
    monkeypatch.syspath_prepend(RECIPES)
    import learned_emulator

    return learned_emulator


@pytest.fixture(scope="module")
def frames():
    """A camera that passes over a blotchy ground of as many dark as bright pixels."""
    ground = cv2.GaussianBlur(np.random.default_rng(0).uniform(0, 255, (48, 120)), (0, 0), 3)
    ranks = ground.ravel().argsort().argsort().reshape(ground.shape) / ground.size
    ground = np.rint(2 * 125**ranks).astype(np.uint8)
    return [VideoFrame(40_000 * n, np.ascontiguousarray(ground[:, 3 * n : 3 * n + 64])) for n in range(14)]


@pytest.fixture
def scene(recipe, frames):
    """The last frames of a sensor's recording, so that pixels are at random distances from their next events."""
    return recipe.Scene.of(*recipe.part(frames[8:], HIDDEN.emulate(frames), 0))


def test_known_settings_are_learned(recipe, scene):
    model = recipe.Pixels()
    recipe.learn(scene, model, 0.0, 80)
    recipe.match_counts(model, scene)
    off, on = model.thresholds.exp().tolist()
    assert on == pytest.approx(HIDDEN.on, rel=0.05)
    assert off == pytest.approx(HIDDEN.off, rel=0.05)
    assert model.dark.exp().item() == pytest.approx(HIDDEN.dark, rel=0.2)
    assert int(model(scene.gray, scene.whole).sum()) == pytest.approx(int(scene.counts.sum()), rel=0.01)


def test_a_network_learns_thresholds_that_differ(recipe, scene):
    # no value of `dark` makes pixels of medium brightness less sensitive than others
    light = scene.gray[scene.whole]
    medium = (light > 8) & (light < 60)
    models = [recipe.Pixels(start=DVS(on=size, off=size)) for size in (0.15, 0.3)]
    with torch.no_grad():
        low, high = (model(scene.gray, scene.whole) for model in models)
    scene = scene._replace(counts=torch.where(medium[:-1, None], high, low))
    plain, network = recipe.Pixels(), recipe.Pixels(network=True)
    assert recipe.learn(scene, network, 0.0, 80) < 0.95 * recipe.learn(scene, plain, 0.0, 80)
    each = network.each(scene.gray[0], scene.gray[scene.whole[1]]).detach()
    assert each[:, medium[0]].median() > 1.2 * each[:, ~medium[0]].median()


def test_events_are_those_of_dvs(recipe, frames):
    ours, theirs = recipe.Pixels(start=HIDDEN).emulate(frames), HIDDEN.emulate(frames)
    keys = [set(zip(*(c.tolist() for c in (e.x, e.y, e.p)), strict=True)) for e in (ours, theirs)]
    assert len(theirs) > 3_000
    assert keys[0] == keys[1]
    counts = [np.bincount((e.p * 48 + e.y) * 64 + e.x.astype(int), minlength=2 * 48 * 64) for e in (ours, theirs)]
    # rounding to float32 decides about a change that is a threshold
    assert (counts[0] != counts[1]).mean() < 0.001
    order = [np.lexsort((e.t, e.p, e.y, e.x)) for e in (ours, theirs)]
    assert len(ours) != len(theirs) or np.abs(ours.t[order[0]] - theirs.t[order[1]]).max() < 100


@pytest.mark.parametrize("name", ["thresholds", "dark", "floor"])
def test_gradient_is_that_of_finite_differences(recipe, scene, name):
    model = recipe.Pixels(start=HIDDEN).double()
    scene = scene._replace(gray=scene.gray.double(), counts=scene.counts.double())
    parameter, everywhere = getattr(model, name), torch.ones(48, 64, dtype=torch.bool)
    recipe.loss(model, scene, everywhere, 0.0).backward()
    found = []
    with torch.no_grad():
        for step in (1e-5, -2e-5):
            parameter += step
            found.append(recipe.loss(model, scene, everywhere, 0.0).item())
    slope = (found[0] - found[1]) / 2e-5
    assert abs(slope) > 1e-4
    assert parameter.grad.sum().item() == pytest.approx(slope, rel=1e-3)


def test_the_recipe_compares_with_the_fitted_pixel(run, frames, tmp_path):
    frames = frames[:6]
    events = HIDDEN.emulate(frames)
    path = tmp_path / "hidden.npz"
    columns = {"t": events.t, "x": events.x, "y": events.y, "p": events.p}
    np.savez(path, frames=np.stack([f.pixels for f in frames]), frame_times=[f.time for f in frames], **columns)
    said = run("learned_emulator.py", path, "--out", tmp_path, "--steps", 20)
    rows = {row["emulator"]: row for row in json.loads((tmp_path / "hidden.json").read_text())}
    assert list(rows) == ["DVS, not fitted", "DVS, fitted", "DVS, learned", "DVS, learned, network"]
    assert rows["DVS, learned"]["correlation"][0] > rows["DVS, not fitted"]["correlation"][0]
    assert (tmp_path / "hidden.txt").read_text() in said
