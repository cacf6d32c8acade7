"""Several processes train and evaluate as one does."""

import json
import shutil

import numpy as np
import pytest
import torch
import trees
from places import RECIPES
from processes_of_others import by_torchrun

from nvsdata import models
from nvsdata.training.actions import Actions

# the fixtures of conftest.py, for other processes
PLOTLESS = """
import runpy, sys
from nvsdata.training import accuracy_by_window, report
assert all(hasattr(accuracy_by_window, name) for name in ("MOST_DRAWS", "FACTORS", "FRACTIONS"))
assert hasattr(report, "_pictures") and hasattr(report, "_sheet")
accuracy_by_window.MOST_DRAWS, accuracy_by_window.FACTORS, accuracy_by_window.FRACTIONS = 1, (0.5, 1.0), (0.5,)
report._pictures, report._sheet = lambda *_: {{}}, lambda *_: None
sys.path.insert(0, {recipes!r})
runpy.run_path({recipes!r} + "/train_objects.py", run_name="__main__")
"""


# trains as the tests of the trainer do: OUT, and the step at which both processes are interrupted
INTERRUPTED = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_trainer import trained
out, at = Path(sys.argv[1]), int(sys.argv[2])
trained(out, every=2, at=at, batch=8, size=52, resume=(out / "checkpoint.pt").exists())
"""


def test_two_processes_continue_within_an_epoch_bit_identically(tmp_path):
    script = tmp_path / "interrupted.py"
    script.write_text(INTERRUPTED.format(tests=str(RECIPES.parent / "tests/training")))
    # 11: in the second epoch
    runs = {"whole": (-1,), "stopped": (11, -1)}
    for out, stops in runs.items():
        for stop in stops:
            result = by_torchrun(2, script, tmp_path / out, stop)
            assert (result.returncode == 0) == (stop < 0), result.stderr[-3000:]
    whole, stopped = (torch.load(tmp_path / out / "checkpoint.pt", weights_only=True) for out in runs)
    assert whole["model"].keys() == stopped["model"].keys()
    assert all(torch.equal(stopped["model"][name], value) for name, value in whole["model"].items())
    losses = [[json.loads(line)["loss"] for line in (tmp_path / out / "log.jsonl").open()] for out in runs]
    assert losses[0] == losses[1]
    assert len(losses[0]) == 2


@pytest.mark.usefixtures("plotless")
def test_a_report_by_two_processes_is_bit_identical_to_that_by_one(run, many, tmp_path):
    victim = many / "Test/3/00002.bin"
    victim.write_bytes(victim.read_bytes()[:-3])
    # five windows of 20 recordings, in seven batches for two processes
    flags = ["--dataset", "n-mnist", "--root", many, "--epochs", 2, "--batch", 15, "--validate", 0.2, "--depth", 3]
    flags = [*map(str, flags), "--errors", "skip", "--device", "cpu", "--out"]
    (tmp_path / "recipe.py").write_text(PLOTLESS.format(recipes=str(RECIPES)))
    result = by_torchrun(2, tmp_path / "recipe.py", *flags, tmp_path / "2")
    assert result.returncode == 0, result.stderr[-3000:]
    shutil.copytree(tmp_path / "2", tmp_path / "1")
    for name in ("report.json", "predictions.csv", "scores.npz", "model.safetensors"):
        (tmp_path / "1" / name).unlink()
    run("train_objects.py", *flags, tmp_path / "1", "--resume")
    one, two = (json.loads((tmp_path / count / "report.json").read_text()) for count in ("1", "2"))
    assert {**one, "run": None} == {**two, "run": None}
    assert (tmp_path / "1/predictions.csv").read_bytes() == (tmp_path / "2/predictions.csv").read_bytes()
    with np.load(tmp_path / "1/scores.npz") as one, np.load(tmp_path / "2/scores.npz") as two:
        assert one["scores"].tobytes() == two["scores"].tobytes()
    one, two = (models.load(tmp_path / count / "model.safetensors").metrics for count in ("1", "2"))
    assert one == two


def test_features_by_three_processes_are_bit_identical_to_those_by_one(run, tmp_path):
    root = trees.put(tmp_path / "aslan", trees.aslandvs(view2=True))
    model = models.RGCNN3D(2, temporal="plain", sensor_size=(240, 180), channels=(8,), clusters=((60, 60),))
    path = models.save(model, tmp_path / "model.safetensors", transform=Actions().pipeline(training=False))
    flags = ["--root", root, "--model", path, "--device", "cpu", "--out"]
    result = by_torchrun(3, RECIPES / "similarity_aslan.py", *flags, tmp_path / "3")
    assert result.returncode == 0, result.stderr[-3000:]
    run("similarity_aslan.py", *flags, tmp_path / "1")
    files = {path.relative_to(tmp_path / "3"): path for path in (tmp_path / "3").rglob("*.npz")}
    assert len(files) == 12
    for name, file in files.items():
        with np.load(file) as three, np.load(tmp_path / "1" / name) as one:
            assert all(one[key].tobytes() == three[key].tobytes() for key in one.files)
    assert (tmp_path / "1/log.jsonl").read_bytes() == (tmp_path / "3/log.jsonl").read_bytes()


@pytest.mark.usefixtures("plotless")
def test_two_processes_give_the_same_training_as_one(run, fake_nmnist, tmp_path):
    # 40 recordings in batches of 15: the last one, of 10, is cut to shares of another size
    flags = ["--dataset", "n-mnist", "--root", fake_nmnist, "--epochs", 1, "--batch", 15, "--votes", 1]
    # deeper networks multiply what is left of rounding: 0.1% of the loss after three steps
    flags += ["--depth", 3]
    flags = [*map(str, flags), "--device", "cpu", "--out"]
    run("train_objects.py", *flags, tmp_path / "1")
    (tmp_path / "recipe.py").write_text(PLOTLESS.format(recipes=str(RECIPES)))
    result = by_torchrun(2, tmp_path / "recipe.py", *flags, tmp_path / "2")
    assert result.returncode == 0, result.stderr[-3000:]
    logs = {
        count: [json.loads(line) for line in (tmp_path / str(count) / "log.jsonl").read_text().splitlines()]
        for count in (1, 2)
    }
    assert [line["epoch"] for line in logs[2]] == [1]
    for one, two in zip(logs[1], logs[2], strict=True):
        assert two["loss"] == pytest.approx(one["loss"], rel=1e-4)
        assert two["train_accuracy"] == one["train_accuracy"]
    one, two = (json.loads((tmp_path / c / "report.json").read_text()) for c in ("1", "2"))
    assert one.keys() == two.keys()
    for quantity in ("accuracy_by_window_us", "accuracy_by_events"):
        assert one[quantity].keys() == two[quantity].keys()
    one, two = (torch.load(tmp_path / c / "checkpoint.pt", weights_only=True)["model"] for c in ("1", "2"))
    rate = logs[1][0]["learning_rate"]
    # Adam steps by the sign of a gradient where that is all but zero, so a few weights may go another way
    for name in one:
        # nothing but rounding is left of the gradient of a bias before a normalization: each of 3 steps may differ
        steps = 3 if name.endswith("conv.bias") else 1
        assert torch.allclose(one[name], two[name], atol=2 * steps * rate), name
