"""The recipes of chapters 3 and 5, run as a user would, on look-alikes of the datasets."""

import functools
import json
import runpy

import numpy as np
import pytest
import torch
import trees
from clips import moving_square, write_video
from learning import on_diagonal
from lookalikes import matlab_bytes
from places import RECIPES

import nvsdata
from nvsdata import models, training
from nvsdata.models.reference import vgg
from nvsdata.training import sgd
from nvsdata.training.actions import FRAME_NETWORKS, Actions


@pytest.fixture
def gestures(tmp_path):
    """Three gestures to train on and three to test on."""
    files = trees.dvs128gesture()
    kept = {name: data for name, data in files.items() if "user01" in name or "user24" in name}
    for name in [name for name in kept if name.endswith(".csv")]:
        kept[name] = b"\r\n".join(kept[name].split(b"\r\n")[:4]) + b"\r\n"
    return trees.put(tmp_path / "gestures", kept)


@pytest.fixture
def slim(monkeypatch):
    """Networks with less to compute: few channels, and a coarse grid for 3D CNNs."""
    small = {"channels": (8, 16, 32), "clusters": ((4, 4), (16, 16), (32, 32))}
    for name, settings in models.CONFIGURATIONS_3D.items():
        monkeypatch.setitem(models.CONFIGURATIONS_3D, name, settings | small)
    monkeypatch.setattr(vgg, "WIDTHS", (4, 8, 8, 8, 8))
    for name in ("VGG", "MotionVector3D"):
        monkeypatch.setattr(models.reference, name, functools.partial(getattr(models.reference, name), hidden=16))


def lines(out):
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def timeless(log):
    return [{k: v for k, v in line.items() if k != "seconds"} for line in log]


@pytest.mark.usefixtures("slim")
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
    assert "3 recordings for training, 3 recordings for testing" in run(
        "train_actions.py", *common, "--out", tmp_path / "a"
    )
    log = lines(tmp_path / "a")
    assert [line["epoch"] for line in log] == [1]

    trained = models.load(tmp_path / "a" / "model.safetensors")
    assert trained.metrics.items() >= log[-1].items()
    assert trained.data["dataset"] == "dvs128-gesture"
    test = nvsdata.DVS128Gesture(gestures, "test")
    assert trained.predict(test.recording(0)) in trained.classes == tuple(test.classes)
    report = json.loads((tmp_path / "a" / "report.json").read_text())
    vote = report["accuracy"]["vote"][0]
    assert vote == trained.metrics["test_accuracy_votes"]
    assert vote == pytest.approx(on_diagonal(report["confusion"]))
    assert vote == pytest.approx(1 - len(report["mistakes"]) / 3)
    assert "33333" in report["accuracy_by_window_us"]
    assert (tmp_path / "a" / "confusion.png").stat().st_size > 1000
    # right and left are different gestures
    assert "Flip" not in repr(trained.transform)

    # resumed from the end, nothing is left to do
    before = timeless(log)
    run("train_actions.py", *common, "--out", tmp_path / "a", "--resume", "--no-report")
    assert timeless(lines(tmp_path / "a")) == before
    with pytest.raises(SystemExit, match="belongs to a run of 1 epochs, not 3"):
        run("train_actions.py", *common[:-1], 3, "--out", tmp_path / "a", "--resume")
    for other in (("--network", "pointnet"), ("--graphs", 16)):
        with pytest.raises(SystemExit, match=r"belongs to another run, whose (protocol|batch) is"):
            run("train_actions.py", *common, *other, "--out", tmp_path / "a", "--resume")


@pytest.mark.parametrize("network", ["pointnet", "resnext3d"])
def test_reference_networks_are_trained(run, gestures, tmp_path, monkeypatch, network):
    # one block of layers for each resolution, and small frames
    kind = functools.partial(FRAME_NETWORKS["resnext3d"][0], depths=(1, 1, 1, 1))
    monkeypatch.setitem(FRAME_NETWORKS, "resnext3d", (kind, 36, 32))
    common = ("--dataset", "dvs128-gesture", "--root", gestures, "--out", tmp_path / "out", "--epochs", 1, "--votes", 1)
    run("train_actions.py", *common, "--network", network, "--events", 64, "--batch", 3, "--device", "cpu")
    assert len(lines(tmp_path / "out")) == 1
    # points are of whole recordings
    lengths = json.loads((tmp_path / "out" / "report.json").read_text())["accuracy_by_window_us"]
    assert (len(lengths) > 1) == (network != "pointnet") == (tmp_path / "out" / "lengths.png").exists()


def test_scenes_are_left_out_one_by_one(run, tmp_path):
    root = trees.put(tmp_path / "yupenn", trees.yupenndvs())
    common = ("--root", root, "--out", tmp_path / "out", "--network", "pointnet", "--events", 32, "--epochs", 1)
    common = (*common, "--device", "cpu")
    run("scenes_yupenn.py", *common, "--folds", 0, 1)
    out = run("scenes_yupenn.py", *common, "--folds", 0, 2, "--resume")
    summary = json.loads(out.splitlines()[-1])
    head, *done = lines(tmp_path / "out")
    assert [line["fold"] for line in done] == [0, 1]
    assert [line["scenes"] for line in done] == [["beach"], ["beach"]]
    assert summary["recordings"] == 2
    assert summary["accuracy"] == np.mean([line["named"] == ["beach"] for line in done])
    # the first one wasn't trained again
    assert "fold-000" not in out
    assert out.count("\nepoch 1, ") == 1
    assert head["epochs"] == 1
    with pytest.raises(SystemExit, match="belongs to a run with protocol Actions"):
        run("scenes_yupenn.py", *common, "--graphs", 16, "--resume")
    with pytest.raises(SystemExit, match="9 recordings can't be divided into 1 groups"):
        run("scenes_yupenn.py", *common, "--groups", 1)


def test_groups_of_any_folder_are_left_out(run, tmp_path):
    files = {f"{name}/{n}.mat": matlab_bytes(trees.some(n)) for n in range(5) for name in "abc"}
    root = trees.put(tmp_path / "data", files)
    options = ("--network", "pointnet", "--events", 32, "--epochs", 1, "--device", "cpu", "--no-flip")
    out = run(
        "scenes_yupenn.py", "--dataset", "folder", "--root", root, "--out", tmp_path / "out", "--groups", 4, *options
    )
    # 15 recordings, of which each group has some of each class, and each recording is in one group
    found = [line["scenes"] for line in lines(tmp_path / "out")[1:]]
    assert sorted(map(len, found)) == [3, 4, 4, 4]
    assert all({*one} == {"a", "b", "c"} for one in found)
    assert json.loads(out.splitlines()[-1])["recordings"] == 15
    (root / "a/0.mat").unlink()
    with pytest.raises(SystemExit, match="belongs to a run with data "):
        run(
            "scenes_yupenn.py",
            "--dataset",
            "folder",
            "--root",
            root,
            "--out",
            tmp_path / "out",
            "--groups",
            4,
            *options,
            "--resume",
        )


@pytest.mark.usefixtures("slim")
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


@pytest.mark.usefixtures("slim")
def test_similarity_of_recordings_of_another_sensor(run, tmp_path):
    size, protocol = (64, 48), Actions(temporal="plain")
    for i in range(4):
        nvsdata.write(trees.some(i, 300, size), tmp_path / f"{i}.h5")
    pairs = [f"{fold},{fold % 4},{(fold + same) % 4},{same}" for fold in range(1, 11) for same in (0, 1)]
    (tmp_path / "aslan_pairs.csv").write_text("\n".join(("fold,video_a,video_b,same", *pairs)))
    model = protocol.build(size, 2)
    path = models.save(model, tmp_path / "model.safetensors", transform=protocol.pipeline(training=False))
    common = ("--root", tmp_path, "--model", path, "--out", tmp_path / "out", "--device", "cpu")
    run("similarity_aslan.py", *common, "--stated-sizes")
    assert lines(tmp_path / "out")[-1]["folds"] == 10
    with pytest.raises(SystemExit, match="240x180, but the network is for 64x64"):
        run("similarity_aslan.py", *common[:5], tmp_path / "other", *common[6:])


@pytest.mark.usefixtures("slim")
def test_transfer_from_emulated_to_real(run, tmp_path, monkeypatch):
    tested = []

    def noted(model, batches, votes, here, *, real=training.votes):
        """The votes, after a look at what was tested on."""
        found = real(model, batches, votes, here)
        tested.append((batches.dataset.dataset.root, votes, list(found.together)))
        return found

    monkeypatch.setattr(training, "votes", noted)
    for kind in ("real", "emulated"):
        trees.put(tmp_path / kind, trees.ucf50dvs())
    (tmp_path / "emulated/UCF50_DVS/PullUps/v_Pullup_g02_c02.aedat").unlink()
    common = ("--real", tmp_path / "real", "--emulated", tmp_path / "emulated", "--out", tmp_path / "out")
    common = (*common, "--frames", 16, "--iterations", 2, "--votes", 2, "--device", "cpu", "--batch", 4)
    out = run("transfer_emulated.py", *common)
    table = json.loads((tmp_path / "out" / "table.json").read_text())
    assert list(table) == ["real -> real", "real -> emulated", "emulated -> real", "emulated -> emulated"]
    assert [(root.name, votes) for root, votes, _ in tested] == 2 * [("real", 2), ("emulated", 2)]
    assert list(table.values()) == [together for *_, together in tested]
    assert f"  {table['real -> emulated'][0]:.3f} (" in out
    trained = models.load(tmp_path / "out" / "real" / "model.safetensors")
    assert trained.classes[0] == "BaseballPitch"
    recordings = sorted((tmp_path / "real").rglob("*.aedat"))[:2]
    assert set(trained.predict(recordings, windows=2)) <= set(trained.classes)


@pytest.fixture
def letters(tmp_path, slim):
    """A video of each of two letters, and the same as recordings; VGG-16 is slim."""
    for n, letter in enumerate("ab"):
        video = write_video(tmp_path / "videos" / letter / "0.avi", moving_square(10, seed=n))
        for kind in ("real", "emulated"):
            (tmp_path / kind / letter).mkdir(parents=True)
            nvsdata.write(nvsdata.PIX2NVS().emulate(video), tmp_path / kind / letter / "0.h5")
    return tmp_path


def test_letters_are_learnt_from_videos_and_emulated(run, letters):
    common = ("--real", letters / "real", "--out", letters / "out", "--iterations", 1, "--votes", 1, "--device", "cpu")
    out = run("sign_language.py", *common, "--emulated", letters / "emulated", "--videos", letters / "videos")
    table = json.loads((letters / "out" / "table.json").read_text())
    assert list(table) == ["gray videos", "emulated"]
    assert all(f"{found[0]:.2%} ({found[1]:.2%} to" in out for found in table.values())
    trained = models.load(letters / "out" / "emulated" / "model.safetensors")
    settings = trained.model.settings
    assert (settings["layers"], settings["in_channels"], settings["dropout"]) == (16, 3, 0.8)
    assert "MedianDenoise" in repr(trained.transform)
    assert trained.predict(next((letters / "real").rglob("*.h5"))) in trained.classes == ("a", "b")
    with pytest.raises(SystemExit, match="nothing to train on"):
        run("sign_language.py", *common)
    (letters / "emulated" / "b").rename(letters / "emulated" / "c")
    with pytest.raises(SystemExit, match=r"has the classes \['a', 'b'\], not \['a', 'c'\]"):
        run("sign_language.py", *common, "--emulated", letters / "emulated")


def test_weights_of_torchvision_are_taken_over(letters, monkeypatch):
    monkeypatch.syspath_prepend(RECIPES)
    recipe = runpy.run_path(str(RECIPES / "sign_language.py"))
    model = models.reference.VGG(2, layers=16, in_channels=3)
    theirs = {
        name.replace("maps.", "features.").replace("classify.", "classifier."): torch.rand_like(value)
        for name, value in model.state_dict().items()
    }
    # of 1,000 classes
    theirs |= {"classifier.6.weight": torch.rand(1000, 16), "classifier.6.bias": torch.rand(1000)}
    torch.save(theirs, letters / "vgg16.pth")
    last = model.classify[6].weight.clone()
    recipe["load_weights"](model, letters / "vgg16.pth")
    assert torch.equal(model.maps[0].weight, theirs["features.0.weight"])
    assert torch.equal(model.classify[3].bias, theirs["classifier.3.bias"])
    assert torch.equal(model.classify[6].weight, last)
    del theirs["features.0.bias"]
    torch.save(theirs, letters / "vgg16.pth")
    with pytest.raises(ValueError, match="doesn't have the weights of torchvision's vgg16"):
        recipe["load_weights"](model, letters / "vgg16.pth")


def test_only_the_layers_that_are_named_decay():
    model = models.reference.MotionVector3D(2, frames=8, size=8, hidden=4)
    optimizer, _ = sgd(model, 0.1, 2, 4, decay=0.5, decayed=[model.classify[0]])
    decays = {p: group["weight_decay"] for group in optimizer.param_groups for p in group["params"]}
    held = set(model.classify[0].parameters())
    assert {p: 0.5 if p in held else 0.0 for p in model.parameters()} == decays
