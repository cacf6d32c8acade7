import json
import subprocess
import sys

import cv2
import pytest
import torch
from learning import on_diagonal
from places import RECIPES

from nvsdata import models

RECIPE = RECIPES / "train_objects.py"


def lines(out):
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def timeless(log):
    return [{k: v for k, v in line.items() if k != "seconds"} for line in log]


def test_trains_resumes_exactly_and_votes(run, fake_nmnist, tmp_path):
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--epochs", 3, "--votes", 2, "--seed", 3)
    common = (*common, "--device", "cpu")
    run("train_objects.py", *common, "--out", tmp_path / "whole")
    log = lines(tmp_path / "whole")
    assert [line["epoch"] for line in log] == [1, 2, 3]
    told = report(tmp_path / "whole")
    assert (told["rounds"], told["recordings"]) == (5, 20)
    assert log[-1]["test_accuracy_votes"] == pytest.approx(on_diagonal(told["confusion"]))
    # mistakes are counted by recording, the shares of classes by true class, of as many recordings each
    assert log[-1]["test_accuracy_votes"] == pytest.approx(1 - sum(m["wrong_votes"] for m in told["mistakes"]) / 20)
    for column, share in told["accuracy"].items():
        assert share == pytest.approx(sum(one[column] for one in told["classes"].values()) / 10)
    # other windows than the report's: 5 rounds of 2 of each recording
    assert log[-1]["test_accuracy"] * 200 == pytest.approx(round(log[-1]["test_accuracy"] * 200))

    # a run that was killed after writing the second line, before its checkpoint
    state = torch.load(tmp_path / "whole" / "checkpoint.pt", weights_only=True)
    assert state["epoch"] == 3
    killed = STOPPED.format(recipe=str(RECIPE))
    arguments = [*map(str, common), "--out", str(tmp_path / "killed")]
    assert subprocess.run([sys.executable, "-c", killed, *arguments], capture_output=True, check=False).returncode == 9
    assert torch.load(tmp_path / "killed" / "checkpoint.pt", weights_only=True)["epoch"] == 1
    assert len(lines(tmp_path / "killed")) == 2
    run("train_objects.py", *common, "--out", tmp_path / "killed", "--resume")
    assert timeless(lines(tmp_path / "killed")) == timeless(log)
    assert not list((tmp_path / "whole").glob(".*"))
    # nothing of a report is left to chance
    assert report(tmp_path / "whole") == report(tmp_path / "killed")


def report(out):
    return json.loads((out / "report.json").read_text())


PICTURES = {"confusion.png", "classes.png", "calibration.png", "votes.png", "lengths.png", "mistakes.png"}


def test_a_training_ends_with_a_report(run, fake_nmnist, tmp_path):
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--out", tmp_path, "--epochs", 1, "--votes", 3)
    common = (*common, "--device", "cpu")
    assert "6 plots" in run("train_objects.py", *common)
    found = report(tmp_path)
    assert (found["recordings"], found["windows"], found["rounds"]) == (20, 3, 5)
    assert found["accuracy"]["vote"] == lines(tmp_path)[-1]["test_accuracy_votes"]
    assert list(found["classes"]) == [str(digit) for digit in range(10)]
    assert len(found["accuracy_by_votes"]) == 3
    assert "30000" in found["accuracy_by_window_us"]
    # an untrained network errs; each mistake names a file
    assert found["mistakes"]
    assert all((fake_nmnist / mistake["recording"]).is_file() for mistake in found["mistakes"])
    shown = {path.name: cv2.imread(str(path)) for path in tmp_path.glob("*.png")}
    assert shown.keys() == PICTURES
    assert all(picture is not None for picture in shown.values())
    # a single window is no vote: its picture goes, and a run that is done writes its report again
    run("train_objects.py", *common, "--resume", "--votes", 1)
    assert {path.name for path in tmp_path.glob("*.png")} == PICTURES - {"votes.png"}
    assert report(tmp_path)["windows"] == 1


def test_without_tensorboard_the_extra_is_named(run, fake_nmnist, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--out", tmp_path)
    with pytest.raises(SystemExit, match=r"train_objects.py: .*pip install 'nvsdata\[tensorboard\]'"):
        run("train_objects.py", *common, "--tensorboard")


# os._exit in place of the second checkpoint, as a power cut would
STOPPED = """
import os, runpy, sys, torch
save, calls = torch.save, []
def dying(*args):
    calls.append(1)
    if len(calls) == 2:
        os._exit(9)
    save(*args)
torch.save = dying
sys.argv[0] = {recipe!r}
sys.path.insert(0, os.path.dirname({recipe!r}))
runpy.run_path({recipe!r}, run_name="__main__")
"""


def test_a_folder_without_splits_is_split(run, fake_nmnist, tmp_path):
    common = ("--dataset", "folder", "--root", fake_nmnist / "Train", "--out", tmp_path / "out", "--epochs", 1)
    common = (*common, "--votes", 1)
    assert "30 recordings to train on, 10 to test on" in run("train_objects.py", *common, "--device", "cpu")
    assert len(lines(tmp_path / "out")) == 1


def test_a_damaged_file_does_not_end_a_training(run, fake_nmnist, tmp_path):
    (fake_nmnist / "Train/3/00002.bin").write_bytes(b"abc")
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--out", tmp_path / "out", "--epochs", 1)
    run("train_objects.py", *common, "--device", "cpu", "--errors", "skip", "--no-report")
    assert [line["damaged"] for line in lines(tmp_path / "out")] == [1]
    assert not {path.name for path in (tmp_path / "out").iterdir()} & (PICTURES | {"report.json"})


@pytest.mark.filterwarnings("ignore:.*takes its place")
def test_a_damaged_recording_to_test_on_is_replaced_in_a_report_too(run, fake_nmnist, tmp_path):
    (fake_nmnist / "Test/3/00002.bin").write_bytes(b"abc")
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--out", tmp_path / "out", "--epochs", 1, "--votes", 2)
    run("train_objects.py", *common, "--device", "cpu", "--errors", "skip")
    # the next recording, of another class, takes its place
    assert [report(tmp_path / "out")["classes"][digit]["recordings"] for digit in "34"] == [1, 3]


def test_a_wrong_root_is_said_plainly(run, tmp_path):
    with pytest.raises(SystemExit, match=r"train_objects.py: .*not a folder"):
        run("train_objects.py", "--dataset", "n-mnist", "--root", tmp_path / "no", "--out", tmp_path)


def test_a_damaged_recording_is_named(run, fake_nmnist, tmp_path):
    bad = fake_nmnist / "Train" / "3" / "00002.bin"
    bad.write_bytes(bad.read_bytes()[:-2])
    with pytest.raises(SystemExit) as ended:
        run("train_objects.py", "--dataset", "n-mnist", "--root", fake_nmnist, "--out", tmp_path / "o", "--epochs", 1)
    assert (
        str(ended.value) == f"train_objects.py: {bad}: byte 2995: truncated: 3 bytes are left over, but a record has 5"
    )


def test_pairs_are_no_classes(run, tmp_path):
    with pytest.raises(SystemExit, match="aslan-dvs is of pairs of recordings"):
        run("train_objects.py", "--dataset", "aslan-dvs", "--root", tmp_path, "--out", tmp_path)


def test_the_flags(run, capsys):
    with pytest.raises(SystemExit) as ended:
        run("train_objects.py", "--help")
    assert ended.value.code == 0
    told = capsys.readouterr().out
    for flag in ("--dataset", "--root", "--out", "--epochs", "--window", "--votes", "--seed", "--device", "--resume"):
        assert flag in told


ABLATIONS = {
    "plain": ("--network", "gcnn", "--convolution", "gcn", "--k", 8),
    "graph": ("--radius", 2, "--kernel-size", 3, "--depth", 4, "--window", 50_000),
    "image": ("--network", "resnet50", "--image-size", 32, "--batch", 20),
}


@pytest.mark.parametrize("flags", ABLATIONS.values(), ids=ABLATIONS)
def test_ablations(run, fake_nmnist, tmp_path, flags):
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--out", tmp_path, "--epochs", 1, "--votes", 1)
    run("train_objects.py", *common, *flags, "--device", "cpu")
    assert len(lines(tmp_path)) == 1
    trained = models.load(tmp_path / "model.safetensors")
    text = repr(trained.transform)
    settings = trained.model.settings
    if "--k" in flags:
        assert "NonUniformSample(k=8, " in text
        assert settings["convolution"] == "gcn"
    elif "--depth" in flags:
        assert "radius=2.0" in text
        assert "duration=50000" in text
        assert (settings["kernel_size"], settings["channels"]) == (3, (32, 64, 64, 128))
    else:
        assert "CenterCrop(size=32)" in text
    assert trained.predict(next(fake_nmnist.rglob("*.bin"))) in trained.classes
