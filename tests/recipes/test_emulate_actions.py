"""Recordings whose class is their motion."""

import importlib

import numpy as np
import pytest
from places import RECIPES

import nvsdata
from nvsdata import EventFolder
from nvsdata.emulation import DVS

SIZE = 48, 36


@pytest.fixture
def recipe(monkeypatch):
    monkeypatch.syspath_prepend(RECIPES)
    return importlib.import_module("emulate_actions")


def still(recipe, monkeypatch):
    """Leave out all that moves in another way than the class."""
    monkeypatch.setattr(recipe, "SHAKE", 0.0)
    monkeypatch.setattr(recipe, "OTHERS", 0)


def pixels(recipe, seed, name):
    return np.stack([frame.pixels for frame in recipe.moving(seed, SIZE, name)])


@pytest.mark.parametrize(
    "pair", [("right", "left"), ("down", "up"), ("clockwise", "counterclockwise"), ("growing", "shrinking")]
)
def test_only_the_order_of_events_distinguishes_the_classes_of_a_pair(recipe, pair):
    forth, back = (pixels(recipe, 3, name) for name in pair)
    assert np.array_equal(forth, back[::-1])
    assert not np.array_equal(forth, back)
    # without a difference of thresholds and noise, pixels have about as many events; what was ON is OFF
    counts = []
    for video, swapped in ((forth, False), (back, True)):
        events = DVS(on=0.1, off=0.1).emulate(video, fps=recipe.FPS)
        image = np.zeros((2, SIZE[1], SIZE[0]))
        np.add.at(image, (events.p ^ swapped, events.y, events.x), 1)
        counts.append(image)
    assert counts[0].sum() > 3_000
    assert abs(counts[0] - counts[1]).mean() < 0.25 * counts[0].mean()


def middle(pixels):
    """The center [2] of what differs from the still background, and the mean distance from it."""
    apart = abs(pixels.astype(float) - 128) > 40
    y, x = np.nonzero(apart)
    center = np.array([x.mean(), y.mean()])
    return center, apart.sum()


@pytest.mark.parametrize("seed", range(4))
def test_shapes_move_as_the_class_says(recipe, monkeypatch, seed):
    still(recipe, monkeypatch)
    moved = {}
    for name in recipe.CLASSES:
        video = pixels(recipe, seed, name)
        (start, before), (end, after) = middle(video[45]), middle(video[75])
        (x, y), (x_end, y_end) = start - np.array(SIZE) / 2, end - np.array(SIZE) / 2
        spin = x * y_end - y * x_end
        moved[name] = *(end - start), spin, after / before
    assert moved["right"][0] > 2 > -2 > moved["left"][0]
    assert moved["down"][1] > 2 > -2 > moved["up"][1]
    assert moved["clockwise"][2] > 0 > moved["counterclockwise"][2]
    assert moved["growing"][3] > 1.2 > 0.8 > moved["shrinking"][3]
    for name in ("right", "left"):
        assert abs(moved[name][1]) < 1


def test_a_folder_of_recordings(tmp_path, run, monkeypatch):
    monkeypatch.syspath_prepend(RECIPES)
    # the threshold is chosen on three videos
    monkeypatch.setattr(importlib.import_module("transfer_digits"), "SOME", 3)
    words = "emulate_actions.py", "--out", tmp_path / "a", "--size", *SIZE, "--events", 4_000, "--train", 2, "--test", 1
    assert "24 recordings by DVS(on=" in run(*words)
    train, test = (EventFolder(tmp_path / "a", split) for split in ("train", "test"))
    assert train.classes == test.classes == sorted(importlib.import_module("emulate_actions").CLASSES)
    assert (train.class_counts, test.class_counts) == ([2] * 8, [1] * 8)
    recordings = [dataset[n][0] for dataset in (train, test) for n in range(len(dataset))]
    assert {events.sensor_size for events in recordings} == {SIZE}
    assert abs(np.mean([len(events) for events in recordings]) / 4_000 - 1) < 0.5
    assert min(events.duration for events in recordings) > 900_000
    common = "--dataset", "folder", "--root", tmp_path / "a", "--network", "pointnet", "--events", 32, "--epochs", 1
    common = (*common, "--votes", 1, "--device", "cpu", "--no-report")
    for flips, words_of in ((True, ()), (False, ("--no-flip",))):
        said = run("train_actions.py", *common, *words_of, "--out", tmp_path / f"flips {flips}")
        assert f"flip={flips}" in said

    # a recording of each class in one subset only: no pair of one class
    assert (tmp_path / "a/aslan_pairs.csv").read_text() == "fold,video_a,video_b,same\n"

    # a stopped run continues with the same events
    gone = next(tmp_path.rglob("*.h5"))
    before = nvsdata.read(gone)
    gone.unlink()
    run(*words)
    again = nvsdata.read(gone)
    assert all(np.array_equal(getattr(again, name), getattr(before, name)) for name in "txyp")
    with pytest.raises(SystemExit, match="has recordings by other settings"):
        run(*words[:-1], 2)


def test_pairs_are_of_test_recordings_in_subsets_without_common_ones(recipe):
    found = list(recipe.pairs(6, 20))
    assert len(found) == len(set(found)) == 10 * 2 * len(recipe.CLASSES)
    used = {}
    for fold, a, b, same in found:
        assert (a % len(recipe.CLASSES) == b % len(recipe.CLASSES)) == same
        for n in (a, b):
            assert 6 * len(recipe.CLASSES) <= n < 26 * len(recipe.CLASSES)
            assert used.setdefault(n, fold) == fold
    for fold in range(1, 11):
        assert sorted(same for n, _, _, same in found if n == fold) == [0] * 8 + [1] * 8
