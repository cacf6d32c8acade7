"""The recipes of chapters 3 and 5, run as a user would, on look-alikes of the datasets."""

import json

import numpy as np
import pytest
import trees

import nvsdata
from nvsdata import models
from nvsdata.training.actions import Actions


@pytest.fixture
def gestures(tmp_path):
    """Three gestures to train on and three to test on."""
    files = trees.dvs128gesture()
    kept = {name: data for name, data in files.items() if "user01" in name or "user24" in name}
    for name in [name for name in kept if name.endswith(".csv")]:
        kept[name] = b"\r\n".join(kept[name].split(b"\r\n")[:4]) + b"\r\n"
    return trees.put(tmp_path / "gestures", kept)


def lines(out):
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def timeless(log):
    return [{k: v for k, v in line.items() if k != "seconds"} for line in log]


def test_gestures_are_trained_resumed_and_used(run, gestures, tmp_path):
    common = (
        "--dataset",
        "dvs128-gesture",
        "--root",
        gestures,
        "--duration",
        250_000,
        "--votes",
        2,
        "--temporal",
        "plain",
    )
    common = (*common, "--device", "cpu", "--epochs", 1)
    assert "3 recordings to train on, 3 to test on" in run("train_actions.py", *common, "--out", tmp_path / "a")
    log = lines(tmp_path / "a")
    assert [line["epoch"] for line in log] == [1]
    assert 0 <= log[-1]["test_accuracy_votes"] <= 1

    trained = models.load(tmp_path / "a" / "model.safetensors")
    assert trained.metrics == log[-1]
    assert trained.data["dataset"] == "dvs128-gesture"
    test = nvsdata.DVS128Gesture(gestures, "test")
    assert trained.predict(test.recording(0)) in trained.classes == tuple(test.classes)
    # right and left are different gestures
    assert "Flip" not in repr(trained.transform)

    # resumed from the end, nothing is left to do
    before = timeless(log)
    run("train_actions.py", *common, "--out", tmp_path / "a", "--resume")
    assert timeless(lines(tmp_path / "a")) == before
    with pytest.raises(SystemExit, match="belongs to a run of 1 epochs, not 3"):
        run("train_actions.py", *common[:-1], 3, "--out", tmp_path / "a", "--resume")
    with pytest.raises(SystemExit, match="belongs to another network"):
        run("train_actions.py", *common, "--network", "pointnet", "--out", tmp_path / "a", "--resume")


@pytest.mark.parametrize("network", ["pointnet", "resnext3d"])
def test_reference_networks_are_trained(run, gestures, tmp_path, network):
    common = ("--dataset", "dvs128-gesture", "--root", gestures, "--out", tmp_path / "out", "--epochs", 1, "--votes", 1)
    run("train_actions.py", *common, "--network", network, "--events", 64, "--batch", 3, "--device", "cpu")
    assert len(lines(tmp_path / "out")) == 1


def test_scenes_are_left_out_one_by_one(run, tmp_path):
    root = trees.put(tmp_path / "yupenn", trees.yupenndvs())
    common = ("--root", root, "--out", tmp_path / "out", "--network", "pointnet", "--events", 32, "--epochs", 1)
    common = (*common, "--device", "cpu")
    run("scenes_yupenn.py", *common, "--folds", 0, 1)
    out = run("scenes_yupenn.py", *common, "--folds", 0, 2, "--resume")
    summary = json.loads(out.splitlines()[-1])
    head, *done = lines(tmp_path / "out")
    assert [line["fold"] for line in done] == [0, 1]
    assert {line["scene"] for line in done} == {"beach"}
    assert summary["recordings"] == 2
    assert summary["accuracy"] == np.mean([line["scene"] == line["named"] for line in done])
    # the first one wasn't trained again
    assert "fold-000" not in out
    assert out.count('"epoch"') == 1
    assert head["epochs"] == 1
    with pytest.raises(SystemExit, match="belongs to a run of Actions"):
        run("scenes_yupenn.py", *common, "--graphs", 16, "--resume")


def test_similarity_of_actions(run, tmp_path):
    root = trees.put(tmp_path / "aslan", trees.aslandvs(view2=True))
    protocol = Actions(temporal="plain")
    model = protocol.build((240, 180), 2)
    path = models.save(model, tmp_path / "model.safetensors", transform=protocol.pipeline(training=False))
    common = ("--root", root, "--model", path, "--out", tmp_path / "out", "--device", "cpu")
    run("similarity_aslan.py", *common)
    *folds, summary = lines(tmp_path / "out")
    # a pair of the second subset has a recording that is missing: there is one of a kind left
    assert [line["pairs"] for line in folds] == [2, 1, 2, 2, 2, 2, 2, 2, 2, 2]
    assert summary["accuracy"] == pytest.approx(np.mean([line["accuracy"] for line in folds]))
    assert folds[1]["auc"] is None
    assert summary["auc"] == pytest.approx(np.mean([line["auc"] for line in folds if line["auc"] is not None]))
    assert (tmp_path / "out" / "roc.png").stat().st_size > 1000
    features = sorted((tmp_path / "out" / "features").rglob("*.npz"))
    with np.load(features[0]) as kept:
        assert [np.linalg.norm(kept[key]) for key in kept.files] == pytest.approx([1, 1], abs=1e-5)
    stamps = [file.stat().st_mtime_ns for file in features]
    run("similarity_aslan.py", *common)
    assert [file.stat().st_mtime_ns for file in features] == stamps


def test_transfer_from_emulated_to_real(run, tmp_path):
    for kind in ("real", "emulated"):
        trees.put(tmp_path / kind, trees.ucf50dvs())
    (tmp_path / "emulated/UCF50_DVS/PullUps/v_Pullup_g02_c02.aedat").unlink()
    common = ("--real", tmp_path / "real", "--emulated", tmp_path / "emulated", "--out", tmp_path / "out")
    common = (*common, "--frames", 16, "--iterations", 2, "--votes", 2, "--device", "cpu", "--batch", 4)
    out = run("transfer_emulated.py", *common)
    table = json.loads((tmp_path / "out" / "table.json").read_text())
    assert list(table) == ["real -> real", "real -> emulated", "emulated -> real", "emulated -> emulated"]
    assert all(0 <= value <= 1 for value in table.values())
    assert f"{table['real -> emulated']:.2%}" in out
    trained = models.load(tmp_path / "out" / "real" / "model.safetensors")
    assert trained.classes[0] == "BaseballPitch"
    recordings = sorted((tmp_path / "real").rglob("*.aedat"))[:2]
    assert set(trained.predict(recordings, windows=2)) <= set(trained.classes)
