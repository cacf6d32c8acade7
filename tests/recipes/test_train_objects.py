import csv
import functools
import json
import shutil
import subprocess
import sys

import cv2
import pytest
import torch
from learning import on_diagonal
from places import RECIPES

import nvsdata
from nvsdata import models
from nvsdata.training import Trainer
from nvsdata.training.objects import IMAGE_NETWORKS

RECIPE = RECIPES / "train_objects.py"


def lines(out):
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def timeless(log):
    return [{k: v for k, v in line.items() if k != "seconds"} for line in log]


@pytest.mark.usefixtures("plotless")
def test_trains_resumes_exactly_and_votes(run, fake_nmnist, tmp_path):
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--epochs", 3, "--votes", 2, "--seed", 3)
    common = (*common, "--device", "cpu")
    run("train_objects.py", *common, "--out", tmp_path / "whole")
    log = lines(tmp_path / "whole")
    assert [line["epoch"] for line in log] == [1, 2, 3]
    output = report(tmp_path / "whole")
    assert (output["rounds"], output["recordings"]) == (5, 20)
    vote, metrics = output["accuracy"]["vote"][0], models.load(tmp_path / "whole" / "model.safetensors").metrics
    assert vote == metrics["test_accuracy_votes"] == pytest.approx(on_diagonal(output["confusion"]))
    # mistakes are counted by recording, the shares of classes by true class, of as many recordings each
    assert vote == pytest.approx(1 - sum(m["wrong_votes"] for m in output["mistakes"]) / 20)
    for column, (share, low, high) in output["accuracy"].items():
        assert share == pytest.approx(sum(one[column][0] for one in output["classes"].values()) / 10)
        assert low < share < high
    # 5 rounds of 2 windows of each recording
    assert metrics["test_accuracy"] * 200 == pytest.approx(round(metrics["test_accuracy"] * 200))
    # test recordings are used at the end only
    assert not any("test" in name for line in log for name in line)

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
    one, two = (report(tmp_path / name) for name in ("whole", "killed"))
    assert one | {"run": None} == two | {"run": None}


def report(out):
    return json.loads((out / "report.json").read_text())


PICTURES = {f"{name}.png" for name in "confusion classes calibration votes lengths events mistakes".split()}


def test_a_training_ends_with_a_report(run, fake_nmnist, tmp_path):
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--out", tmp_path, "--epochs", 1, "--votes", 3)
    common = (*common, "--device", "cpu")
    assert "7 plots" in run("train_objects.py", *common)
    found = report(tmp_path)
    assert (found["recordings"], found["windows"], found["rounds"]) == (20, 3, 5)
    assert found["accuracy"]["vote"][0] == models.load(tmp_path / "model.safetensors").metrics["test_accuracy_votes"]
    assert found["tested_on"] == "test"
    assert (found["run"]["epoch"], found["run"]["epoch_chosen_by"]) == (1, "the number of epochs")
    with (tmp_path / "predictions.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 20
    assert all((fake_nmnist / row["recording"]).is_file() and row["windows"] == "15" for row in rows)
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


class Untouchable(nvsdata.NMNIST):
    """Fails where a test recording is read before the last step."""

    allowed = False

    def recording(self, index):
        assert self.allowed or self.split_name == "train", "test data were read while something was still chosen"
        return super().recording(index)


@pytest.mark.usefixtures("plotless")
@pytest.mark.parametrize("validate", [0, 0.4])
def test_test_recordings_are_read_after_training_only(run, many, tmp_path, monkeypatch, validate):
    monkeypatch.setattr("nvsdata.training.data.dataset_named", lambda name: Untouchable)
    monkeypatch.setattr(Untouchable, "allowed", False)
    real = Trainer.fit

    def fit(self, *arguments):
        found = real(self, *arguments)
        Untouchable.allowed = True
        return found

    monkeypatch.setattr(Trainer, "fit", fit)
    common = ("--dataset", "n-mnist", "--root", many, "--out", tmp_path / "out", "--epochs", 2, "--votes", 1)
    said = run("train_objects.py", *common, "--device", "cpu", "--validate", validate, "--k", 8)
    found = report(tmp_path / "out")
    assert ("for validation" in said) == ("validation_hash" in found["data"]) == bool(validate)
    assert all(("validation_accuracy" in line) == bool(validate) for line in lines(tmp_path / "out"))
    if validate:
        best = max(lines(tmp_path / "out"), key=lambda line: (line["validation_accuracy"], line["epoch"]))
        assert (found["run"]["epoch"], found["run"]["epoch_chosen_by"]) == (best["epoch"], "validation accuracy")


@pytest.mark.usefixtures("plotless")
def test_a_run_is_repeated_from_its_report(run, fake_nmnist, tmp_path):
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--epochs", 1, "--votes", 1, "--k", 8, "--seed", 4)
    run("train_objects.py", *common, "--device", "cpu", "--out", tmp_path / "one")
    again = ("--from", tmp_path / "one/report.json")
    run("train_objects.py", *again, "--out", tmp_path / "two")
    one, two = (torch.load(tmp_path / name / "checkpoint.pt", weights_only=True) for name in ("one", "two"))
    assert all(torch.equal(weights, two["model"][name]) for name, weights in one["model"].items())
    assert report(tmp_path / "one") | {"run": None} == report(tmp_path / "two") | {"run": None}
    with pytest.raises(SystemExit, match="--from needs another --out than"):
        run("train_objects.py", *again)
    with pytest.raises(SystemExit, match=r"is a report of train_objects\.py"):
        run("train_actions.py", *again, "--out", tmp_path / "three")
    (fake_nmnist / "Train/3/00002.bin").unlink()
    with pytest.raises(SystemExit, match=r"differs from the data of .*report\.json: hash"):
        run("train_objects.py", *again, "--out", tmp_path / "three")
    for content in (b"{}", b"[1", b'{"run": {"command": [1]}, "data": {}}'):
        (tmp_path / "bad.json").write_bytes(content)
        with pytest.raises(SystemExit, match=r"bad\.json is not the report\.json of a run"):
            run("train_objects.py", "--from", tmp_path / "bad.json", "--out", tmp_path / "three")


def test_shared_recordings_and_empty_validation_are_said(run, fake_nmnist, tmp_path):
    shutil.copy(fake_nmnist / "Train/3/00002.bin", fake_nmnist / "Test/4/00777.bin")
    for recording in (fake_nmnist / "Test/7").iterdir():
        recording.unlink()
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--epochs", 1, "--votes", 1, "--k", 8, "--no-report")
    said = run("train_objects.py", *common, "--device", "cpu", "--out", tmp_path / "out")
    assert "1 test recordings are also training recordings, such as Test/4/00777.bin (Train/3/00002.bin)" in said
    assert "warning: 1 classes have no recording for testing: 7\n" in said
    with pytest.raises(SystemExit, match=r"a validation fraction of 0\.01 leaves no recordings of 0, 1"):
        run("train_objects.py", *common, "--out", tmp_path / "other", "--validate", 0.01)


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


@pytest.mark.usefixtures("plotless")
def test_a_folder_without_splits_is_split(run, fake_nmnist, tmp_path):
    common = ("--dataset", "folder", "--root", fake_nmnist / "Train", "--out", tmp_path / "out", "--epochs", 1)
    common = (*common, "--votes", 1)
    assert "30 recordings for training, 10 recordings for testing" in run(
        "train_objects.py", *common, "--device", "cpu"
    )
    assert len(lines(tmp_path / "out")) == 1


def test_a_damaged_file_does_not_end_a_training(run, fake_nmnist, tmp_path):
    (fake_nmnist / "Train/3/00002.bin").write_bytes(b"abc")
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--out", tmp_path / "out", "--epochs", 1)
    run("train_objects.py", *common, "--device", "cpu", "--errors", "skip", "--no-report")
    assert [line["damaged"] for line in lines(tmp_path / "out")] == [1]
    assert not {path.name for path in (tmp_path / "out").iterdir()} & (PICTURES | {"report.json"})


@pytest.mark.usefixtures("plotless")
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
    with pytest.raises(SystemExit, match="aslan-dvs consists of pairs of recordings"):
        run("train_objects.py", "--dataset", "aslan-dvs", "--root", tmp_path, "--out", tmp_path)


def test_the_flags(run, capsys):
    with pytest.raises(SystemExit) as ended:
        run("train_objects.py", "--help")
    assert ended.value.code == 0
    output = capsys.readouterr().out
    for flag in ("--dataset", "--root", "--out", "--epochs", "--window", "--votes", "--seed", "--device", "--resume"):
        assert flag in output


ABLATIONS = {
    "plain": ("--network", "gcnn", "--convolution", "gcn", "--k", 8),
    "graph": ("--radius", 2, "--kernel-size", 3, "--depth", 4, "--window", 50_000),
    "image": ("--network", "resnet50", "--image-size", 32, "--batch", 20),
}


@pytest.mark.usefixtures("plotless")
@pytest.mark.parametrize("flags", ABLATIONS.values(), ids=ABLATIONS)
def test_ablations(run, fake_nmnist, tmp_path, monkeypatch, flags):
    # one block of layers for each resolution
    monkeypatch.setitem(IMAGE_NETWORKS, "resnet50", functools.partial(IMAGE_NETWORKS["resnet50"], depths=(1, 1, 1, 1)))
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


@pytest.mark.usefixtures("plotless")
def test_another_dataset_is_tested_on(run, fake_nmnist, tmp_path):
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--epochs", 1, "--votes", 1, "--k", 8, "--device", "cpu")
    other = shutil.copytree(fake_nmnist / "Train", tmp_path / "digits")
    # of a sensor twice as large, which is scaled to that of the training
    for path in list(other.rglob("*.bin")):
        events = nvsdata.read(path, sensor_size=(34, 34))
        wide = nvsdata.transforms.resize_events(events, 68, 68)
        nvsdata.write(wide, path.with_suffix(".h5"))
        path.unlink()
    run("train_objects.py", *common, "--test-dataset", "folder", "--test-root", other, "--out", tmp_path / "out")
    found = report(tmp_path / "out")
    # a folder has no test split of its own: all recordings are tested on
    assert (found["recordings"], found["data"]["test_dataset"]) == (40, "folder")
    # the weights are those of a training that is tested on its own dataset
    run("train_objects.py", *common, "--out", tmp_path / "own")
    one, two = (torch.load(tmp_path / name / "checkpoint.pt", weights_only=True) for name in ("out", "own"))
    assert all(torch.equal(weights, two["model"][name]) for name, weights in one["model"].items())


def test_other_datasets_need_the_same_classes_and_a_root(run, fake_nmnist, tmp_path, capsys):
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--out", tmp_path / "out", "--test-dataset", "folder")
    shutil.copytree(fake_nmnist / "Train", tmp_path / "digits")
    (tmp_path / "digits/9").rename(tmp_path / "digits/nine")
    expected = "folder can't test networks for the classes of n-mnist: only n-mnist has 9; only folder has nine"
    with pytest.raises(SystemExit, match=expected):
        run("train_objects.py", *common, "--test-root", tmp_path / "digits")
    with pytest.raises(SystemExit):
        run("train_objects.py", *common)
    assert "--test-dataset and --test-root go together" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="not a folder"):
        run("train_objects.py", *common, "--test-root", tmp_path / "no")
