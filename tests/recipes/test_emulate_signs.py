"""Drawn letters in place of hand signs: videos, emulated recordings, and those of a simulated camera."""

import importlib
import json

import cv2
import numpy as np
import pytest
from places import RECIPES

import nvsdata
from nvsdata import EventFolder, models
from nvsdata.emulation import PIX2NVS
from nvsdata.video.frames import frames_of


@pytest.fixture
def recipe(monkeypatch):
    monkeypatch.syspath_prepend(RECIPES)
    recipe = importlib.import_module("emulate_signs")
    monkeypatch.setattr(recipe, "LETTERS", "AC")
    return recipe


@pytest.fixture
def signs(recipe, tmp_path, monkeypatch):
    def draw(*options):
        monkeypatch.setattr("sys.argv", ["emulate_signs.py", "--out", str(tmp_path / "signs"), *map(str, options)])
        recipe.main()
        return tmp_path / "signs"

    return draw


def test_letters_are_filmed_and_seen_by_a_camera(signs):
    root = signs("--train", 2, "--test", 1)
    assert {kind: EventFolder(root / kind).classes for kind in ("emulated", "real")} == {
        "emulated": ["A", "C"],
        "real": ["A", "C"],
    }
    assert (len(EventFolder(root / "emulated")), len(EventFolder(root / "real"))) == (4, 2)
    videos = sorted((root / "videos").rglob("*.mp4"))
    assert [video.stem for video in videos] == ["00000", "00002", "00001", "00003"]
    # half a second in 15 steps
    assert {len(list(frames_of(video))) for video in videos} == {16}
    for recording in (root / "emulated").rglob("*.h5"):
        video = root / "videos" / recording.parent.name / f"{recording.stem}.mp4"
        assert nvsdata.read(recording) == PIX2NVS().emulate(str(video))
    for recording in (root / "real").rglob("*.h5"):
        assert len(nvsdata.read(recording)) > 500


def test_an_interrupted_run_continues(signs):
    root = signs("--train", 1, "--test", 1)
    made = {path: path.stat().st_mtime_ns for path in root.rglob("*.*") if path.suffix != ".txt"}
    assert len(made) == 6
    lost = root / "real/A/00002.h5"
    lost.unlink()
    signs("--train", 1, "--test", 1)
    found = {path: path.stat().st_mtime_ns for path in made}
    assert [path for path in made if found[path] != made[path]] == [lost]
    with pytest.raises(ValueError, match=r"has recordings by other settings \(1 \+ 1 of each letter\)"):
        signs("--train", 2, "--test", 1)


def test_letters_are_drawn_in_many_ways(recipe, monkeypatch):
    monkeypatch.setattr(recipe, "texture", lambda rng, shape, mean, contrast: np.full(shape, 70.0))
    drawings = {name: [recipe.drawn(name, seed) != 70 for seed in range(8)] for name in ("A", "C")}
    for name, shapes in drawings.items():
        assert len({shape.tobytes() for shape in shapes}) == 8, name
        # pixels of the letter, of which none is at the edge
        assert {
            80 < shape.sum() < 1_200 and not (shape[[0, -1]].any() or shape[:, [0, -1]].any()) for shape in shapes
        } == {True}, name
    # an A has a hole (in an outline font two), a C has none
    holes = {name: [_parts(~shape) - 1 for shape in shapes] for name, shapes in drawings.items()}
    assert min(holes["A"]) > 0
    assert holes["C"] == [0] * 8


def _parts(mask):
    """The number of connected parts of the mask."""
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)[0] - 1


def test_a_small_network_is_trained_on_them(run, signs, tmp_path):
    root, out = signs("--train", 1, "--test", 1), tmp_path / "out"
    data = [word for kind in ("real", "emulated") for word in (f"--{kind}", root / kind)]
    options = ("--network", "resnet50", "--image-size", 32, "--no-flip", "--iterations", 1, "--votes", 1)
    run("sign_language.py", *data, *options, "--out", out, "--device", "cpu")
    assert list(json.loads((out / "table.json").read_text())) == ["emulated"]
    trained = models.load(out / "emulated/model.safetensors")
    assert type(trained.model).__name__ == "ResNet"
    # 32 of the 37 pixels, as the 224 of 256 in the thesis
    assert "Resize(size=37)" in repr(trained.transform)
    assert "MotionCrop(size=32)" in repr(trained.transform)
    with pytest.raises(SystemExit):
        run("sign_language.py", *data, *options, "--out", out, "--weights", "vgg16.pth")
