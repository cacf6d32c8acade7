import json
import subprocess
import sys
from pathlib import Path

import pytest

from nvsdata import models

RECIPE = Path(__file__).parents[2] / "recipes" / "train_objects.py"


def recipe(*arguments, ok=True):
    command = [sys.executable, str(RECIPE), "--device", "cpu", *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert (result.returncode == 0) == ok, result.stderr
    return result


def lines(out):
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def timeless(log):
    return [{k: v for k, v in line.items() if k != "seconds"} for line in log]


def test_trains_resumes_exactly_and_votes(fake_nmnist, tmp_path):
    common = ("--dataset", "n-mnist", "--root", fake_nmnist, "--epochs", 4, "--votes", 2, "--seed", 3)
    recipe(*common, "--out", tmp_path / "whole")
    log = lines(tmp_path / "whole")
    assert [line["epoch"] for line in log] == [1, 2, 3, 4]
    assert 0 <= log[-1]["test_accuracy"] <= 1
    assert 0 <= log[-1]["test_accuracy_votes"] <= 1

    # a run that was killed after writing the third line, before its checkpoint
    import torch

    state = torch.load(tmp_path / "whole" / "checkpoint.pt", weights_only=True)
    assert state["epoch"] == 4
    killed = STOPPED.format(recipe=str(RECIPE))
    arguments = [*map(str, common), "--out", str(tmp_path / "killed"), "--device", "cpu"]
    assert subprocess.run([sys.executable, "-c", killed, *arguments], capture_output=True, check=False).returncode == 9
    assert torch.load(tmp_path / "killed" / "checkpoint.pt", weights_only=True)["epoch"] == 2
    assert len(lines(tmp_path / "killed")) == 3
    recipe(*common, "--out", tmp_path / "killed", "--resume")
    assert timeless(lines(tmp_path / "killed")) == timeless(log)
    assert not list((tmp_path / "whole").glob(".*"))


# os._exit in place of the third checkpoint, as a power cut would
STOPPED = """
import os, runpy, sys, torch
save, calls = torch.save, []
def dying(*args):
    calls.append(1)
    if len(calls) == 3:
        os._exit(9)
    save(*args)
torch.save = dying
sys.argv[0] = {recipe!r}
runpy.run_path({recipe!r}, run_name="__main__")
"""


def test_a_folder_without_splits_is_split(fake_nmnist, tmp_path):
    recipe("--dataset", "folder", "--root", fake_nmnist / "Train", "--out", tmp_path / "out", "--epochs", 1)
    assert len(lines(tmp_path / "out")) == 1


def test_a_wrong_root_is_said_plainly(tmp_path):
    assert "no folder" in recipe("--dataset", "n-mnist", "--root", tmp_path / "no", "--out", tmp_path, ok=False).stderr


def test_the_flags():
    told = recipe("--help").stdout
    for flag in ("--dataset", "--root", "--out", "--epochs", "--window", "--votes", "--seed", "--device", "--resume"):
        assert flag in told


ABLATIONS = {
    "plain": ("--network", "gcnn", "--convolution", "gcn", "--k", 8),
    "graph": ("--radius", 2, "--kernel-size", 3, "--depth", 2, "--window", 50_000),
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
        assert (settings["kernel_size"], settings["channels"]) == (3, (128, 256))
    else:
        assert "CentreCrop(size=32)" in text
    assert trained.predict(next(fake_nmnist.rglob("*.bin"))) in trained.classes
